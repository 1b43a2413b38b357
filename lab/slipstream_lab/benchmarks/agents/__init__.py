"""What the agents of a depot cost: `make bench-agents`."""
