"""What `slipstream check` looks for: in each file by its kind, and between files."""
