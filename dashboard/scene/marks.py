"""What can be labelled and selected on the map: marks with a place, found again by a click."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from dashboard.scene.geometry import Array

Kind = Literal["van", "road", "rsu", "stop", "depot"]
IMPORTANCE: Final[dict[Kind, int]] = {"depot": 0, "rsu": 2, "van": 1, "stop": 3, "road": 4}
"""Which labels go first where there is no room for all; a smaller number is shown before."""
PICK_PX: Final = 16.0
"""How far beside a vehicle or a camera a click still selects it, px."""


@dataclass(frozen=True)
class Mark:
    """Something on the map with a name.

    Attributes:
        kind: what it is.
        id: its name among those of its kind.
        text: its label.
        position: in the scene, of the point that the label stands above.
        urgent: in trouble, so that it is labelled before the others of its kind.
    """

    kind: Kind
    id: str
    text: str
    position: tuple[float, float, float]
    urgent: bool = False


@dataclass(frozen=True)
class Eye:
    """A browser's camera.

    Attributes:
        position: in the scene.
        turn: (3, 3), from the camera's axes (x right, y down, z ahead) to the scene's.
        fov_rad: vertical field of view.
        width_px: of the canvas.
        height_px: of the canvas.
    """

    position: Array
    turn: Array
    fov_rad: float
    width_px: int
    height_px: int

    @property
    def focal_px(self) -> float:
        """Size in px, at a depth of 1, of what is 1 long."""
        return float(self.height_px / 2 / np.tan(self.fov_rad / 2))

    def pixels(self, positions: npt.NDArray[np.floating]) -> tuple[Array, Array]:
        """Where positions, (N, 3), are seen, (N, 2) in px from the upper left, and their depths."""
        seen = (np.asarray(positions, dtype=np.float64).reshape(-1, 3) - self.position) @ self.turn
        depth = np.maximum(seen[:, 2], 1e-6)
        middle = np.array([self.width_px / 2, self.height_px / 2])
        return seen[:, :2] / depth[:, None] * self.focal_px + middle, seen[:, 2]


def at_pixel(eye: Eye, marks: Sequence[Mark], pixel: Array) -> Mark | None:
    """The vehicle, else the camera, that is drawn nearest to a pixel, if it is near enough."""
    for kind in ("van", "rsu"):
        here = [mark for mark in marks if mark.kind == kind]
        if not here:
            continue
        pixels, depth = eye.pixels(np.array([mark.position for mark in here]))
        away_px = np.where(depth > 0, np.hypot(*(pixels - pixel).T), np.inf)
        nearest = int(np.argmin(away_px))
        if away_px[nearest] <= PICK_PX:
            return here[nearest]
    return None
