"""Errors of states and tracks against ground truth, and the flag's sensitivity to noise."""

from research.perception.noise import PAPER_STABLE_SHARE, NoiseTable, noise_table
from research.perception.score import Comparison, Scores, compare, score, true_windows

__all__ = [
    "PAPER_STABLE_SHARE",
    "Comparison",
    "NoiseTable",
    "Scores",
    "compare",
    "noise_table",
    "score",
    "true_windows",
]
