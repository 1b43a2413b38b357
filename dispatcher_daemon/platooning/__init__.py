"""Who drives with whom: rewards of shared segments, what a meeting saves, the platoons that exact
times give, and vehicles of earlier cycles that are still on the road."""
