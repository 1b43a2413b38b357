"""Meetings of vehicles: options and departures of each, blocks, sweeps over blocks."""
