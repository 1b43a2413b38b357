"""Learning what hidden vehicles do to features: what was put in comes out."""

from __future__ import annotations

import numpy as np
import pytest

from edge_daemon.features.occlusion import OcclusionCorrection
from slipstream_lab.benchmarks.accuracy.allowances import Errors, fit, left_out
from slipstream_lab.benchmarks.accuracy.clips import CLIPS, LEARNED_FROM

TRUE = OcclusionCorrection(0.4, 0.03, 0.2)


def drawn(clips: int, windows: int, seed: int = 1) -> Errors:
    """Windows whose errors follow the model, with stated errors of 1 %."""
    rng = np.random.default_rng(seed)
    clip = np.repeat(np.arange(clips), windows).astype(np.float64)
    ratio = rng.uniform(0, 0.8, len(clip))
    spread = np.sqrt(0.01**2 + TRUE.share**2 + (TRUE.growth * ratio) ** 2)
    error = TRUE.bias * ratio + spread * rng.standard_normal(len(clip))
    return Errors(error, np.full(len(clip), 0.01), ratio, clip)


def test_the_allowance_that_made_the_errors_is_found() -> None:
    """From 2,000 independent windows, each number to within a tenth or so."""
    found = fit(drawn(20, 100))
    assert found.bias == pytest.approx(TRUE.bias, rel=0.1)
    assert found.growth == pytest.approx(TRUE.growth, rel=0.1)
    assert found.share == pytest.approx(TRUE.share, abs=0.01)


def test_clips_that_are_left_out_are_covered_as_promised() -> None:
    """95 % where the model holds; far less without any allowance."""
    errors = drawn(8, 40)
    assert np.mean(left_out(errors)) == pytest.approx(0.95, abs=0.04)
    assert errors.covered(OcclusionCorrection(0.0, 0.0, 0.0)) < 0.3


def test_a_long_clip_weighs_no_more_than_a_short_one() -> None:
    """Two clips, one with ten times the windows: the bias lies in the middle."""
    ratio = np.ones(110)
    clip = np.array([0.0] * 100 + [1.0] * 10)
    noise = np.random.default_rng(1).normal(0, 0.01, 110)
    found = fit(Errors(np.where(clip == 0, 0.0, 1.0) + noise, np.zeros(110), ratio, clip))
    assert found.bias == pytest.approx(0.5, abs=0.05)


def test_nothing_is_learned_from_the_clips_that_judge() -> None:
    """No clip, no seed in common."""
    worlds = {(clip.world, clip.seed) for clip in CLIPS}
    assert not worlds & {(clip.world, clip.seed) for clip in LEARNED_FROM}
    assert len({clip.name for clip in LEARNED_FROM}) == len(LEARNED_FROM)
