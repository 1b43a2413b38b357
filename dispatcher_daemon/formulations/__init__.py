"""Routing problems as models that solvers take: arc-form QUBO, linearised MILP."""
