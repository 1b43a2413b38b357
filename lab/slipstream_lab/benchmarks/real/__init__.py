"""Real roads: published ground truth of speeds, and frames labelled by hand."""
