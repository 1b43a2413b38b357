"""Benchmarks of the quantum solvers and of the hardware path."""
