"""Solvers behind one protocol, and the worker processes that they run in."""
