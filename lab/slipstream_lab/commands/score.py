"""`slipstream track --truth`: a recording scored against the truth of a clip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edge_daemon.camera import Camera
    from edge_daemon.offline import Recorder
    from edge_daemon.settings import StabilitySettings


def scores_against(
    path: Path, camera: Camera
) -> Callable[[Recorder, StabilitySettings], dict[str, Any]]:
    """What scores a recording against the truth in a file, which is read at once. Raises
    InputError: the file cannot be used.
    """
    from slipstream_lab.research.perception import compare, score
    from slipstream_lab.simulation.ground_truth import load_truth

    truth = load_truth(path)

    def scores(recorder: Recorder, rule: StabilitySettings) -> dict[str, Any]:
        return asdict(score([compare(recorder, truth, camera, rule)]))

    return scores
