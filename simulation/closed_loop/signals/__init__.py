"""Signals and the fleet: what RSUs broadcast of them, asking for green, when to leave."""
