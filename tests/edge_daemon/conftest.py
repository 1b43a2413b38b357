"""A camera over a straight road, and vehicles on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from edge_daemon.camera import Camera, load_camera
from edge_daemon.tracking.measurement import RoadPoints

POLE_M = 9.0
FOCAL_PX = 1000.0
TILT = 0.20


def project(points_m: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Pinhole picture of road points: a camera on a pole at the origin that looks along +x."""
    x, y = np.asarray(points_m, dtype=np.float64).reshape(-1, 2).T
    forward = x * np.cos(TILT) + POLE_M * np.sin(TILT)
    down = POLE_M * np.cos(TILT) - x * np.sin(TILT)
    return np.column_stack([640 - FOCAL_PX * y / forward, 360 + FOCAL_PX * down / forward])


def camera_toml(points_m: list[tuple[float, float]] | None = None, extra: str = "") -> str:
    """A camera.toml of that camera."""
    points_m = points_m or [(20, -8), (20, 8), (45, -8), (45, 8), (80, -8), (80, 8)]
    lines = ["schema = 1", 'name = "test"', "[image]", "width = 1280", "height = 720"]
    for (u, v), (x, y) in zip(project(points_m), points_m, strict=True):
        lines += ["[[points]]", f"image = [{u:.6f}, {v:.6f}]", f"road = [{x}, {y}]"]
    lines += [
        "[[segments]]",
        'id = "approach"',
        "polygon = [[20.0, 0.0], [80.0, 0.0], [80.0, 7.0], [20.0, 7.0]]",
        "direction = [-1.0, 0.0]",
        "lanes = 2",
        "lane_width_m = 3.5",
    ]
    return "\n".join(lines) + "\n" + extra


@pytest.fixture
def camera(tmp_path: Path) -> Camera:
    """The loaded camera."""
    path = tmp_path / "camera.toml"
    path.write_text(camera_toml())
    return load_camera(path)


def seen_at(points_m: npt.NDArray[np.float64], sigma_m: float, score: float = 0.9) -> RoadPoints:
    """Detections at road points with isotropic noise of that size."""
    n = len(points_m)
    return RoadPoints(
        np.asarray(points_m, dtype=np.float64).reshape(-1, 2),
        np.tile(np.eye(2) * sigma_m**2, (n, 1, 1)),
        np.tile([1.0, 0.0], (n, 1)),
        np.full(n, score, dtype=np.float32),
        np.zeros((n, 4), dtype=np.float32),
        np.zeros(n, dtype=np.int64),
    )
