"""Settings of a SUMO view: the clip's and the RSU file, both checked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from slipstream.config import Settings, load
from slipstream.errors import InputError
from slipstream.messages import Identifier

Finite = Annotated[float, Field(allow_inf_nan=False)]
Pair = tuple[Finite, Finite]
Count = Annotated[float, Field(ge=0, le=200)]


class MastSettings(Settings):
    """Where the camera hangs, in the net's coordinates."""

    x_m: Finite
    y_m: Finite
    height_m: Annotated[float, Field(ge=2, le=60)] | None = Field(
        default=None,
        description="Above the road; drawn from 9.5 to 11.5 m by the seed if left out.",
    )
    spread_m: Annotated[float, Field(ge=0, le=20)] = Field(
        default=0.0, description="How far the seed may move the mast in x and in y."
    )


class ViewSettings(Settings):
    """Where the camera looks, and its lens; left-out values are drawn by the seed."""

    look_at_m: Pair | None = Field(
        default=None,
        description="Road point in the picture's middle; or heading_deg and pitch_deg.",
    )
    heading_deg: Finite | None = Field(
        default=None, description="Clockwise from north (+y), as SUMO's angles are."
    )
    pitch_deg: Annotated[float, Field(gt=0, lt=90)] | None = Field(
        default=None, description="Below the horizontal."
    )
    roll_deg: Annotated[float, Field(ge=-45, le=45)] | None = Field(
        default=None, description="Clockwise; drawn from -0.6 to 0.6."
    )
    focal_px: Annotated[float, Field(ge=50, le=20000)] | None = Field(
        default=None, description="Focal length; drawn from 960 to 1100 for a width of 1280 px."
    )
    spread_m: Annotated[float, Field(ge=0, le=20)] = Field(
        default=0.0, description="How far the seed may move the point looked at in x and in y."
    )
    width_px: Annotated[int, Field(ge=64, le=4096, multiple_of=2)] = 1280
    height_px: Annotated[int, Field(ge=64, le=4096, multiple_of=2)] = 720


class WatchSettings(Settings):
    """A stretch of an edge that the camera watches."""

    edge: Identifier
    from_m: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = Field(
        default=None, description="Along the edge; the part in view 20 to 80 m away if left out."
    )
    to_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    from_lane: Annotated[int, Field(ge=0)] = Field(
        default=0, description="Rightmost lane that is watched, 0 is the edge's."
    )
    id: Identifier | None = Field(default=None, description="Segment's id; the edge's if left out.")


class SceneSettings(Settings):
    """Weather, roadside and sensor."""

    seed: Annotated[int, Field(ge=0)] | None = Field(
        default=None, description="Of light and scenery; the clip's seed if left out."
    )
    sky: Literal["any", "clear", "overcast"] = "any"
    buildings: Count = Field(default=12.0, description="Mean number.")
    trees: Count = Field(default=26.0, description="Mean number.")
    lamp_spacing_m: Annotated[float, Field(ge=10, le=1000)] = 45.0
    blur_px: Annotated[float, Field(ge=0, le=10)] | None = Field(
        default=None, description="Sigma; drawn from 0.4 to 0.7."
    )
    noise_levels: Annotated[float, Field(ge=0, le=60)] | None = Field(
        default=None, description="Sigma in grey levels; drawn from 1.5 to 3."
    )


class RsuSettings(Settings):
    """The content of an RSU file."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Identifier
    mast: MastSettings
    view: ViewSettings
    watch: tuple[WatchSettings, ...] = Field(
        default=(), description="Edges watched; every edge along the view if left out."
    )
    scene: SceneSettings = SceneSettings()


def load_rsu(path: Path) -> RsuSettings:
    """Read an RSU file.

    Raises:
        InputError: an unknown key, a value out of range, a direction given twice or not at all, an
            edge watched from behind its own end, two segments with one id.
    """
    rsu = load(path, RsuSettings)
    view = rsu.view
    angles = view.heading_deg is not None and view.pitch_deg is not None
    some = view.heading_deg is not None or view.pitch_deg is not None
    if (view.look_at_m is None) != angles or (some and not angles):
        raise InputError(
            path,
            "where the camera looks is not clear",
            "give look_at_m, or heading_deg and pitch_deg",
            key="view",
        )
    ids = [watch.id or watch.edge for watch in rsu.watch]
    for watch in rsu.watch:
        if ids.count(watch.id or watch.edge) > 1:
            raise InputError(path, "two segments with one id", "give an id", key="watch.id")
        if watch.from_m is not None and watch.to_m is not None and watch.from_m >= watch.to_m:
            raise InputError(
                path, "from_m is not before to_m", "mend one", key=f"watch.{watch.edge}"
            )
    return rsu


@dataclass(frozen=True)
class SumoClipSettings:
    """What to render.

    Args:
        net: a SUMO net.
        routes: a SUMO route file.
        rsu: an RSU file.
        additional: further SUMO files.
        seconds: length, up to an hour.
        fps: frames per second, 5 to 60.
        begin_s: simulated time of the first frame; what comes before fills the road.
        seed: of the traffic, the camera's drawn values, light and scenery.

    Raises:
        InputError: a value is out of range.
    """

    net: Path
    routes: Path
    rsu: Path
    additional: tuple[Path, ...] = ()
    seconds: float = 30.0
    fps: float = 30.0
    begin_s: float = 120.0
    seed: int = 1

    def __post_init__(self) -> None:
        for key, value, low, high in (
            ("seconds", self.seconds, 0.1, 3600.0),
            ("fps", self.fps, 5.0, 60.0),
            ("begin", self.begin_s, 0.0, 604800.0),
            ("seed", float(self.seed), 0.0, 2.0**31 - 1),
        ):
            if not (math.isfinite(value) and low <= value <= high):
                raise InputError(
                    "clip settings",
                    f"{value:.12g} is out of range",
                    f"give {low:.12g} to {high:.12g}",
                    key=key,
                )

    @property
    def frames(self) -> int:
        """Number of frames of the clip."""
        return max(1, round(self.seconds * self.fps))
