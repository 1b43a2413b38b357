"""Platoon coordination, planned only: freight trips by a written law, rivals, and an upper bound.

docs/coordination.md has the law, the model and what was measured.
"""
