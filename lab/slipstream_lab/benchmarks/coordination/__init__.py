"""Platoon coordination, planned only: strategies and a bound by density, window and carriers."""
