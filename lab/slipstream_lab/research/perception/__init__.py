"""Errors of states and tracks against ground truth, and the flag's sensitivity to noise."""

from slipstream_lab.research.perception.counts import (
    CountScore,
    compare_counts,
    score_counts,
    true_passages,
)
from slipstream_lab.research.perception.noise import PAPER_STABLE_SHARE, NoiseTable, noise_table
from slipstream_lab.research.perception.score import (
    Scores,
    TrackComparison,
    compare,
    score,
    true_windows,
)

__all__ = [
    "PAPER_STABLE_SHARE",
    "CountScore",
    "NoiseTable",
    "Scores",
    "TrackComparison",
    "compare",
    "compare_counts",
    "noise_table",
    "score",
    "score_counts",
    "true_passages",
    "true_windows",
]
