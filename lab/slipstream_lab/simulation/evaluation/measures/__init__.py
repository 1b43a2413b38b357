"""Figures of an evaluation: arms against the baseline, at equal time, and their upper bounds."""

from slipstream_lab.simulation.evaluation.measures.ceilings import (
    Ceilings,
    compute_ceilings,
    share_of_ceiling,
)
from slipstream_lab.simulation.evaluation.measures.compare import Compared, SeedSpread
from slipstream_lab.simulation.evaluation.measures.curves import (
    BIN_S,
    HOUR_S,
    Array,
    Course,
    day_course,
)
from slipstream_lab.simulation.evaluation.measures.evaluation import Evaluation, Headline, collect
from slipstream_lab.simulation.evaluation.measures.figures import Measures
from slipstream_lab.simulation.evaluation.measures.platoons import no_platoons

__all__ = [
    "BIN_S",
    "HOUR_S",
    "Array",
    "Ceilings",
    "Compared",
    "Course",
    "Evaluation",
    "Headline",
    "Measures",
    "SeedSpread",
    "collect",
    "compute_ceilings",
    "day_course",
    "no_platoons",
    "share_of_ceiling",
]
