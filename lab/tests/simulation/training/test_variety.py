"""Training ranges of weather and of varied vehicles draw what they promise."""

from __future__ import annotations

import numpy as np
import pytest

from slipstream_lab.simulation.streetdrive.rendering import CLEAR
from slipstream_lab.simulation.streetdrive.vehicles import CLASS_OF_SHAPE, build_vehicle
from slipstream_lab.simulation.training.ranges import (
    CONDITIONS,
    draw_conditions,
)
from slipstream_lab.simulation.training.variety import any_paint, uneven_light, varied_mesh


@pytest.mark.parametrize("kind", CONDITIONS)
def test_each_kind_of_conditions_is_what_its_name_says(kind):
    """The property that the name promises holds in each of many draws."""
    holds = {
        "night": lambda c: c.night,
        "rain": lambda c: c.rain_mm_h >= 1,
        "fog": lambda c: 60 <= c.visibility_m <= 500,
        "low sun": lambda c: c.low_sun,
        "snow": lambda c: c.snow_mm_h > 0,
        "dirt": lambda c: c.dirt >= 0.1,
        "motion": lambda c: c.exposure_s >= 0.01,
    }[kind]
    rng = np.random.default_rng(1)
    drawn = [draw_conditions(rng, (kind,)) for _ in range(40)]
    assert all(holds(given) for given in drawn)
    assert len(set(drawn)) > 20 or kind == "low sun"
    assert CLEAR not in drawn


@pytest.mark.parametrize("shape", list(CLASS_OF_SHAPE))
def test_a_varied_vehicle_keeps_its_class_and_about_its_size(shape):
    """Bodies differ, stand on the ground, and stay within a quarter of their size."""
    plain = build_vehicle(shape, np.random.default_rng(2))
    varied = [varied_mesh(plain, np.random.default_rng(seed)) for seed in range(6)]
    for mesh in varied:
        assert CLASS_OF_SHAPE[mesh.kind] == CLASS_OF_SHAPE[shape]
        assert len(mesh.sizes) > len(plain.sizes)
        assert mesh.outline[:, 2].min() == pytest.approx(0.0, abs=0.05)
        assert mesh.length_m == pytest.approx(plain.length_m, rel=0.25)
        assert mesh.height_m == pytest.approx(plain.height_m, rel=0.35)
        for normals in (mesh.normals, mesh.shading):
            assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(len(normals)))
    assert len({round(mesh.length_m, 4) for mesh in varied}) == 6


def test_paints_cover_the_hues_and_light_is_uneven():
    """Drawn paints hold greys and all hues; patches change the picture but not its level."""
    rng = np.random.default_rng(3)
    paints = np.array([any_paint(rng) for _ in range(300)])
    strongest = np.bincount(paints.argmax(axis=1), minlength=3)
    assert strongest.min() > 40
    assert 0.4 < np.mean(np.ptp(paints, axis=1) < 40) < 0.8
    image = np.full((90, 160, 3), 120, dtype=np.uint8)
    patched = uneven_light(image, rng)
    assert patched.std() > 2
    assert patched.mean() == pytest.approx(120, abs=15)
