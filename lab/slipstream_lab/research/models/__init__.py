"""Anybody's optimisation models: read from files, solved by the solvers that can take them."""

from slipstream_lab.research.models.coordinates import Vartype
from slipstream_lab.research.models.milp import MilpAnswer, MilpModel, solve_milp_model
from slipstream_lab.research.models.qubo import QuboFile
from slipstream_lab.research.models.read import FORMATS, read_model

__all__ = [
    "FORMATS",
    "MilpAnswer",
    "MilpModel",
    "QuboFile",
    "Vartype",
    "read_model",
    "solve_milp_model",
]
