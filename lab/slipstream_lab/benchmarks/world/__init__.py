"""Simulated days: run times, reproducibility and savings."""
