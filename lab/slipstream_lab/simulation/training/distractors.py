"""Upright things beside the road that a detector must not take for vehicles."""

from __future__ import annotations

import numpy as np

from slipstream_lab.simulation.streetdrive.rendering import (
    Colour,
    Corner,
    Material,
    Mesh,
    MeshBuilder,
    PlacedMesh,
)
from slipstream_lab.simulation.streetdrive.traffic import Road


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


_RAIL_M = 8.0


def _rail(rng: np.random.Generator) -> Mesh:
    """A piece of guard rail, 8 m long, on its posts."""
    b = MeshBuilder()
    tone = _tone(rng, 90, 200)
    for x in (-2.0, 2.0):
        b.box((x - 0.06, x + 0.06), (-0.06, 0.06), (0.0, 0.7), tone)
    b.box((-_RAIL_M / 2, _RAIL_M / 2), (-0.05, 0.05), (0.45, 0.75), tone, layer=1)
    return b.build("rail", _RAIL_M, 0.2)


def _distractor(rng: np.random.Generator) -> Mesh:
    """A pedestrian, a traffic sign or a switch cabinet."""
    kind = rng.random()
    if kind < 0.5:
        return _pedestrian(rng)
    return _sign(rng) if kind < 0.8 else _cabinet(rng)


def draw_distractors(rng: np.random.Generator, road: Road, mean: float) -> list[PlacedMesh]:
    """Upright things beside the carriageway that are no vehicles."""
    placed = []
    for _ in range(int(rng.poisson(mean))):
        side = 1.0 if rng.random() < 0.5 else -1.0
        edge = road.left_edge_m if side > 0 else -road.right_edge_m
        y = side * (edge + rng.uniform(0.5, 4.0))
        placed.append(PlacedMesh(_distractor(rng), float(rng.uniform(10, 90)), float(y), 1))
    return placed


def draw_rails(rng: np.random.Generator, road: Road) -> list[PlacedMesh]:
    """Now and then guard rails along the edges or in the middle of the road."""
    placed = []
    for y in (road.left_edge_m + 0.7, 0.0, road.right_edge_m - 0.7):
        if rng.random() < 0.35:
            mesh = _rail(rng)
            start = float(rng.uniform(8, 30))
            placed += [
                PlacedMesh(mesh, start + _RAIL_M * i, y, 1) for i in range(int(rng.integers(4, 16)))
            ]
    return placed
