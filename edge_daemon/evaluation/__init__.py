"""How far the states and tracks of a clip are from its ground truth."""

from edge_daemon.evaluation.score import Recorder, Scores, score
from edge_daemon.evaluation.truth import Truth, load_truth

__all__ = ["Recorder", "Scores", "Truth", "load_truth", "score"]
