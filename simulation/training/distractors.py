"""Upright things beside the road that a detector must not take for vehicles."""

from __future__ import annotations

import numpy as np

from simulation.streetdrive.rendering import Colour, Corner, Material, Mesh, MeshBuilder


def _tone(rng: np.random.Generator, low: float, high: float) -> Colour:
    b, g, r = (float(c) for c in rng.uniform(low, high, 3))
    return (b, g, r)


def _pedestrian(rng: np.random.Generator) -> Mesh:
    b = MeshBuilder()
    tall = rng.uniform(1.55, 1.9)
    b.box((-0.12, 0.12), (-0.16, 0.16), (0.0, 0.48 * tall), _tone(rng, 25, 90), layer=0)
    coat = [(0.14, 0.2, 0.45 * tall, 0.84 * tall), (-0.14, 0.22, 0.45 * tall, 0.84 * tall)]
    b.loft(coat, _tone(rng, 30, 200), layer=1, material=Material.MATT)
    b.box((-0.1, 0.1), (-0.09, 0.09), (0.86 * tall, tall), (120, 145, 185), layer=2)
    return b.build("pedestrian", 0.5, 0.5)


def _sign(rng: np.random.Generator) -> Mesh:
    b = MeshBuilder()
    top, half = rng.uniform(2.2, 3.2), rng.uniform(0.3, 0.7)
    b.box((-0.04, 0.04), (-0.04, 0.04), (0.0, top), (130, 132, 132))
    for x, out in ((-0.06, -1.0), (0.06, 1.0)):
        panel: list[Corner] = [
            (x, -half, top - 2 * half),
            (x, half, top - 2 * half),
            (x, half, top),
            (x, -half, top),
        ]
        b.face(panel, _tone(rng, 30, 220), (out, 0, 0), material=Material.MATT, layer=1)
    return b.build("sign", 0.2, 2 * half)


def _cabinet(rng: np.random.Generator) -> Mesh:
    b = MeshBuilder()
    half_l, half_w, top = rng.uniform(0.3, 0.9), rng.uniform(0.25, 0.5), rng.uniform(0.8, 1.6)
    b.box((-half_l, half_l), (-half_w, half_w), (0.0, top), _tone(rng, 60, 190))
    return b.build("cabinet", 2 * half_l, 2 * half_w)


def build_distractor(rng: np.random.Generator) -> Mesh:
    """A pedestrian, a traffic sign or a switch cabinet."""
    kind = rng.random()
    if kind < 0.5:
        return _pedestrian(rng)
    return _sign(rng) if kind < 0.8 else _cabinet(rng)
