"""The accuracy benchmark: its clips are held out, and its table tells misses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slipstream_cli.main import parser
from slipstream_lab.benchmarks.accuracy.clips import CLIPS, LEARNED_FROM, WEATHER
from slipstream_lab.benchmarks.accuracy.report import (
    AccuracyRow,
    classes,
    count_misses,
    counts,
    features,
    misses,
    table,
)
from slipstream_lab.research.perception import CountScore, Scores
from slipstream_lab.research.perception.score import ClassScore, FeatureScore
from slipstream_lab.simulation.streetdrive.clip import draw_clip_camera
from slipstream_lab.simulation.streetdrive.traffic.road import Road

GOOD = Scores(
    speed_mae_kmh=0.8,
    speed_p95_kmh=2.5,
    speed_covered_95=0.95,
    speeds=1000,
    acceleration_variance_abs_error=0.05,
    acceleration_variance_windows=100,
    y_e_agreement=0.97,
    y_e_agreement_outside_band=0.99,
    y_e_known=0.95,
    y_e_windows=400,
    y_e_windows_outside_band=380,
    idf1=0.97,
    hota=0.9,
    features={"mean_speed_mps": FeatureScore(0.05, 0.01, 0.94, 400)},
    classes={"car": ClassScore(40, 0.98, 0.5, 900), "bus": ClassScore(1, 0.0, None, 0)},
)


def test_there_are_enough_clips_of_both_worlds() -> None:
    """Twenty or more, no two alike, several of each world."""
    assert len(CLIPS) >= 20
    assert len({clip.name for clip in CLIPS}) == len(CLIPS)
    for world in ("streetdrive", "sumo"):
        assert sum(clip.world == world for clip in CLIPS) >= 8


def test_the_command_takes_the_arguments_of_all_clips() -> None:
    """A benchmark would notice only after minutes."""
    weather = [clip for clips in WEATHER.values() for clip in clips]
    for clip in (*CLIPS, *LEARNED_FROM, *weather):
        assert parser().parse_args(["clip", *clip.arguments, "--out", "clip"]).seed == clip.seed


@pytest.mark.parametrize(
    "seed", [clip.seed for clip in CLIPS if clip.world == "streetdrive"], ids=str
)
def test_streetdrives_cameras_lie_in_the_bins_that_training_leaves_out(seed: int) -> None:
    """Every fourth bin of 0.4 m of height and of 40 px of focal length is held out."""
    camera = draw_clip_camera(np.random.default_rng([seed, 0]), Road())
    assert int(camera.height_m / 0.4) % 4 == 3
    assert int(camera.focal_px / 40.0) % 4 == 3


def test_a_good_run_misses_nothing() -> None:
    """All targets are bounds that may be touched."""
    assert misses(GOOD) == []
    assert misses(replace(GOOD, speed_mae_kmh=1.0, y_e_agreement=0.95)) == []
    assert "!" not in table([], [AccuracyRow("all", GOOD)])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("speed_mae_kmh", 1.01),
        ("speed_p95_kmh", 3.5),
        ("acceleration_variance_abs_error", 0.2),
        ("y_e_agreement", 0.94),
        ("y_e_agreement_outside_band", 0.97),
        ("idf1", 0.9),
        ("idf1", None),
    ],
)
def test_a_miss_is_told_and_marked(field: str, value: float | None) -> None:
    """A figure that is absent is a miss too."""
    bad = replace(GOOD, **{field: value})
    (miss,) = misses(bad)
    assert str(value) in miss
    total = table([AccuracyRow("clip", GOOD)], [AccuracyRow("all", bad)]).splitlines()[-2]
    assert total.startswith("all")
    assert total.count("!") == 1


def test_features_are_listed_with_their_coverage() -> None:
    """One line each."""
    assert "mean_speed_mps" in features(GOOD)
    assert "0.940" in features(GOOD)


def test_classes_stand_in_a_table_of_their_own() -> None:
    """One that was never followed has no speed."""
    _, car, bus = classes(GOOD).splitlines()
    assert car.split() == ["car", "40", "0.980", "0.500", "900"]
    assert bus.split() == ["bus", "1", "0.000", "0"]


COUNTED = CountScore(
    true=100,
    counted=95,
    by_class={"car": (80, 78), "truck": (20, 18), "bus": (0, 0), "motorcycle": (0, 1)},
    covered_95=0.9,
    segments=10,
    mean_error_kmh=0.4,
    v85_error_kmh=None,
)


def test_counts_stand_beside_the_truth() -> None:
    """As counted/true, all and by class."""
    _, line = counts([("all", COUNTED)]).splitlines()
    figures = ["all", "95/100", "-5.0%", "0.90", "78/80", "18/20", "0/0", "1/0", "0.40"]
    assert line.split() == figures


def test_counts_miss_beyond_five_per_cent_and_ten_of_a_class() -> None:
    """A class that was never there cannot be missed; nothing to count is a miss."""
    assert count_misses(COUNTED) == []
    assert count_misses(replace(COUNTED, counted=94)) == ["counts: -6.0%, target ± 5%"]
    fewer = {**COUNTED.by_class, "truck": (20, 17)}
    assert count_misses(replace(COUNTED, by_class=fewer)) == ["counts, truck: -15.0%, target ± 10%"]
    assert count_misses(replace(COUNTED, true=0, by_class={})) == [
        "counts: nothing to count, target ± 5%"
    ]
