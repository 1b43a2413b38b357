"""Real pictures for the detector: their sources, a teacher's answers, and learning from both."""

from slipstream_lab.simulation.training.distillation.distil import Batches, DistilSettings, distil
from slipstream_lab.simulation.training.distillation.judging import (
    JUDGED_HEIGHT_PX,
    RealFigures,
    judge_cameras,
)
from slipstream_lab.simulation.training.distillation.sources import (
    RealCamera,
    mixed_pictures,
    of_role,
    read_sources,
)
from slipstream_lab.simulation.training.distillation.teacher import Answer, CocoTeacher, Teacher

__all__ = [
    "JUDGED_HEIGHT_PX",
    "Answer",
    "Batches",
    "CocoTeacher",
    "DistilSettings",
    "RealCamera",
    "RealFigures",
    "Teacher",
    "distil",
    "judge_cameras",
    "mixed_pictures",
    "of_role",
    "read_sources",
]
