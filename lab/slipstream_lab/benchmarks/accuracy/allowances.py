"""`make allowances`: how hidden vehicles falsify the features, learned from clips with truth.

The error of a feature over its scale is taken as normal around bias · h, with the variance that the
feature's standard error states, plus share² + (growth · h)², where h is the road hidden over the
road visible. Maximum likelihood, each clip with the same weight. A clip's windows overlap and share
a camera, so the fit is validated by leaving whole clips out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.optimize import minimize

from edge_daemon.camera import Array, load_camera
from edge_daemon.detection import open_detector
from edge_daemon.features.kinematics import WindowFeatures
from edge_daemon.features.occlusion import (
    OCCLUSION_CORRECTIONS,
    OcclusionCorrection,
    feature_scales,
    occlusion_ratio,
)
from edge_daemon.offline import Recorder
from edge_daemon.pipeline import Pipeline
from edge_daemon.settings import TrackSettings
from edge_daemon.sources.clip import FastClip, open_clip
from slipstream_cli.progress import ProgressLine
from slipstream_lab.benchmarks.accuracy.clips import LEARNED_FROM, make
from slipstream_lab.research.perception import compare
from slipstream_lab.simulation.ground_truth import load_truth

_SURE: Final = 1.96
_STARTS: Final = ((0.0, 0.02, 0.1), (0.0, 0.1, 0.3))


@dataclass(frozen=True)
class Errors:
    """One feature's errors over its scale, a value a window.

    Attributes:
        error: truth less feature of the seen vehicles, over the scale, shape (n,).
        stated: the feature's standard error over the scale, shape (n,).
        ratio: road hidden over road visible, shape (n,).
        clip: number of the window's clip, shape (n,).
    """

    error: Array
    stated: Array
    ratio: Array
    clip: Array

    def of(self, wanted: Array) -> Errors:
        """Those windows only."""
        return Errors(
            self.error[wanted], self.stated[wanted], self.ratio[wanted], self.clip[wanted]
        )

    @property
    def weight(self) -> Array:
        """Of each window: as much for one clip as for another, shape (n,)."""
        _, number, counts = np.unique(self.clip, return_inverse=True, return_counts=True)
        return np.asarray(1 / counts[number])

    def covered(self, allowance: OcclusionCorrection) -> float:
        """Share of the windows whose truth lies in the 95 % interval; NaN without windows."""
        spread = np.sqrt(_variance(self, allowance))
        off = np.abs(self.error - allowance.bias * self.ratio)
        return float(np.mean(off <= _SURE * spread)) if len(off) else float("nan")


def fit(errors: Errors) -> OcclusionCorrection:
    """The likeliest allowance."""
    weight = errors.weight

    def cost(numbers: Array) -> float:
        allowance = OcclusionCorrection(*numbers)
        variance = _variance(errors, allowance)
        off = errors.error - allowance.bias * errors.ratio
        return float(np.sum(weight * (np.log(variance) + off**2 / variance)))

    found = [
        minimize(cost, start, method="Nelder-Mead", options={"maxiter": 4000, "xatol": 1e-5})
        for start in _STARTS
    ]
    bias, share, growth = min(found, key=lambda each: float(each.fun)).x
    return OcclusionCorrection(float(bias), float(abs(share)), float(abs(growth)))


def _variance(errors: Errors, allowance: OcclusionCorrection) -> Array:
    grown = allowance.growth * errors.ratio
    return np.asarray(errors.stated**2 + allowance.share**2 + grown**2 + 1e-9)


def left_out(errors: Errors) -> list[float]:
    """What each clip's windows are covered by a fit to the other clips."""
    shares = []
    for clip in np.unique(errors.clip):
        others = errors.clip != clip
        shares.append(errors.of(~others).covered(fit(errors.of(others))))
    return shares


def measured(folders: Sequence[Path]) -> dict[str, Errors]:
    """Errors of all features over the windows of clips."""
    rows: dict[str, list[tuple[float, float, float, float]]] = {
        name: [] for name in OCCLUSION_CORRECTIONS
    }
    with ProgressLine("clips", sys.stderr) as progress:
        for number, folder in enumerate(folders):
            for name, row in _rows(folder):
                rows[name].append((*row, number))
            progress.update(number + 1, len(folders))
    return {name: Errors(*np.array(each).T) for name, each in rows.items()}


def _rows(folder: Path) -> list[tuple[str, tuple[float, float, float]]]:
    """Feature, error, stated error and ratio of each covered window of a clip."""
    camera, settings = load_camera(folder / "camera.toml"), TrackSettings()
    detector = open_detector(settings.detector, camera)
    pipeline = Pipeline("learning", camera, detector, settings.stability, settings.window_s)
    recorder, windows, due_s = Recorder(), dict[int, WindowFeatures](), 0.0
    clip = FastClip(open_clip(folder / "video.mp4", loop=False, size=camera.size))
    for frame in clip.frames():
        recorder.frame(frame.media_time_s, pipeline.process(frame))
        if frame.media_time_s < due_s:
            continue
        due_s += settings.state_interval_s
        states = pipeline.states(frame.captured_ns)
        recorder.tick(frame.media_time_s, settings.state_interval_s, states, pipeline.vehicles)
        for state in states:
            window = pipeline.windows[state.segment]
            if window is not None:
                windows[state.sequence] = window
    truth = load_truth(folder / "truth.csv")
    rows = []
    for state, true in compare(recorder, truth, camera, settings.stability).windows:
        window = windows.get(state.sequence)
        if window is None or window.occluded_share is None:
            continue
        for name, scale in feature_scales(window.seen).items():
            seen, value = getattr(window.seen, name), getattr(true, name)
            if seen is not None and value is not None and scale > 0:
                off, stated = (value - seen.value) / scale, (seen.standard_error or 0.0) / scale
                rows.append((name, (off, stated, occlusion_ratio(window.occluded_share))))
    return rows


def main() -> None:
    """Print the table of `edge_daemon/features/occlusion.py`, and how far it can be trusted."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.accuracy.allowances", description=__doc__
    )
    parser.add_argument("--folder", type=Path, default=Path(".slipstream/accuracy"))
    options = parser.parse_args()
    folders = [folder for _, folder in make(options.folder, LEARNED_FROM)]
    for name, errors in measured(folders).items():
        allowance = fit(errors)
        numbers = f"{allowance.bias:.3f}, {allowance.share:.3f}, {allowance.growth:.3f}"
        shares = left_out(errors)
        before = errors.covered(OcclusionCorrection(0.0, 0.0, 0.0))
        print(
            f'    "{name}": OcclusionCorrection({numbers}),'
            f"  # {len(errors.error)} windows; in 95 % "
            f"{100 * before:.0f} % before, {100 * errors.covered(allowance):.0f} % after, "
            f"clips left out {100 * np.mean(shares):.0f} % (least {100 * min(shares):.0f} %)"
        )


if __name__ == "__main__":
    main()
