"""How far the states and tracks of a clip are from its ground truth."""

from edge_daemon.evaluation.score import Comparison, Recorder, Scores, compare, score
from edge_daemon.evaluation.truth import Truth, load_truth

__all__ = ["Comparison", "Recorder", "Scores", "Truth", "compare", "load_truth", "score"]
