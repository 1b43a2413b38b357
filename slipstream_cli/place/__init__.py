"""Sub-commands for one's own place: its roads, its first files."""
