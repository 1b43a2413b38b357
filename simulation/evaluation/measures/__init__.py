"""Figures of an evaluation: arms against the baseline, at equal time, and their upper bounds."""

from simulation.evaluation.measures.ceilings import (
    Ceilings,
    Where,
    ceilings,
    share_of_ceiling,
    where,
)
from simulation.evaluation.measures.compare import Compared, Spread
from simulation.evaluation.measures.curves import BIN_S, HOUR_S, Array, Course, course
from simulation.evaluation.measures.evaluation import Evaluation, collect
from simulation.evaluation.measures.figures import Measures

__all__ = [
    "BIN_S",
    "HOUR_S",
    "Array",
    "Ceilings",
    "Compared",
    "Course",
    "Evaluation",
    "Measures",
    "Spread",
    "Where",
    "ceilings",
    "collect",
    "course",
    "share_of_ceiling",
    "where",
]
