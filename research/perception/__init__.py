"""How far states and tracks are from ground truth, and how the flag bears noise on its features."""

from research.perception.noise import PAPER_STABLE_SHARE, NoiseTable, noise_table
from research.perception.score import Comparison, Scores, compare, score

__all__ = [
    "PAPER_STABLE_SHARE",
    "Comparison",
    "NoiseTable",
    "Scores",
    "compare",
    "noise_table",
    "score",
]
