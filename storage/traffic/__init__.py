"""Traffic that RSUs reported: gates as changes, states as roll-ups, the newest as they came."""
