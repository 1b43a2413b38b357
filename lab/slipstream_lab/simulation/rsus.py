"""Roadside units of a simulation: what each one watches, and its camera.

A file has any number of RSUs (`RsuFile`), or a single one by its camera (`RsuSettings`).
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from slipstream.config import Settings, load, read_data
from slipstream.errors import InputError
from slipstream.messages import Identifier
from slipstream.roads import RoadNetwork

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


class RsuWatchSettings(Settings):
    """A stretch of an edge that the camera watches."""

    edge: Identifier
    from_m: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = Field(
        default=None, description="Along the edge; the part in view 20 to 80 m away if left out."
    )
    to_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    from_lane: Annotated[int, Field(ge=0)] = Field(
        default=0, description="Lane nearest to the kerb that is watched; 0 is at the kerb."
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
    """The content of a file of one camera."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Identifier
    mast: MastSettings
    view: ViewSettings
    watch: tuple[RsuWatchSettings, ...] = Field(
        default=(), description="Edges watched; every edge along the view if left out."
    )
    scene: SceneSettings = SceneSettings()


class WatchedStretch(Settings):
    """A watched part of a segment; distances from its beginning."""

    segment: Identifier
    from_m: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    to_m: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    from_lane: Annotated[int, Field(ge=0)] = Field(
        default=0,
        description="Lane nearest to the kerb that is watched; so lanes for leaving and "
        "joining a motorway can be left out.",
    )

    def holds(self, middle_m: float, lane: int) -> bool:
        """Whether a vehicle whose middle is there is watched."""
        return lane >= self.from_lane and self.from_m <= middle_m < self.to_m


class Rsu(Settings):
    """One roadside unit."""

    id: Identifier
    watch: Annotated[tuple[WatchedStretch, ...], Field(min_length=1)]
    keep_s: Annotated[float, Field(ge=0, le=3600)] = Field(
        default=0.0, description="As `stability.keep_s` of its edge daemon."
    )
    mast: MastSettings | None = Field(
        default=None,
        description="Where its camera hangs; beside its first stretch if left out. With a view.",
    )
    view: ViewSettings | None = Field(
        default=None, description="Where its camera looks: along the traffic if left out."
    )
    scene: SceneSettings = SceneSettings()


class RsuFile(Settings):
    """The content of a file of RSUs."""

    rsus: Annotated[tuple[Rsu, ...], Field(min_length=1)]


def is_one_camera(path: Path) -> bool:
    """Whether a file is of a single camera. Raises InputError: it cannot be read."""
    data = read_data(path)
    return isinstance(data, dict) and "schema" in data


def load_rsu(path: Path) -> RsuSettings:
    """Read an RSU file of one camera.

    Raises:
        InputError: an unknown key, a value out of range, a direction given twice or not at all, an
            edge watched from behind its own end, two segments with one id.
    """
    rsu = load(path, RsuSettings)
    _check_view(rsu.view, path, "view")
    ids = [watch.id or watch.edge for watch in rsu.watch]
    for watch in rsu.watch:
        if ids.count(watch.id or watch.edge) > 1:
            raise InputError(path, "two segments with one id", "give an id", key="watch.id")
        if watch.from_m is not None and watch.to_m is not None and watch.from_m >= watch.to_m:
            raise InputError(
                path, "from_m is not before to_m", "mend one", key=f"watch.{watch.edge}"
            )
    return rsu


def load_rsus(path: Path, network: RoadNetwork) -> tuple[Rsu, ...]:
    """Read RSUs and check them against a network.

    Args:
        path: RSUs (`RsuFile`), or one camera's file (`RsuSettings`) that says its metres.

    Raises:
        InputError: the file is malformed, an id twice, a segment that the network has not, a
            stretch or a lane that does not lie on it, two stretches of one segment under one RSU,
            or a mast without a view.
    """
    rsus = (_of_one_camera(path),) if is_one_camera(path) else load(path, RsuFile).rsus
    twice = next((name for name, n in Counter(rsu.id for rsu in rsus).items() if n > 1), None)
    if twice is not None:
        raise InputError(path, "two RSUs with this id", "rename one", key=twice)
    for rsu in rsus:
        if (rsu.mast is None) != (rsu.view is None):
            missing = "view" if rsu.view is None else "mast"
            problem, mend = "a mast and a view belong together", f"give the {missing} too"
            raise InputError(path, problem, mend, key=rsu.id)
        if rsu.view is not None:
            _check_view(rsu.view, path, f"{rsu.id}.view")
        for stretch in rsu.watch:
            segment = network.segments.get(stretch.segment)
            key = f"{rsu.id}.watch.{stretch.segment}"
            if sum(other.segment == stretch.segment for other in rsu.watch) > 1:
                # Its states would have one key and one road for two.
                mend = "give one stretch, or an RSU for each"
                raise InputError(path, "two stretches of one segment", mend, key=key)
            if segment is None:
                problem = f"no segment {stretch.segment!r} in net {network.name!r}"
                raise InputError(path, problem, "name one of the net's connected part", key=key)
            if not stretch.from_m < stretch.to_m <= segment.length_m:
                raise InputError(
                    path,
                    f"{stretch.from_m:g} to {stretch.to_m:g} m of a segment of "
                    f"{segment.length_m:.0f} m",
                    "mend from_m and to_m",
                    key=key,
                )
            if stretch.from_lane >= segment.lanes:
                problem = f"lane {stretch.from_lane} of a segment of {segment.lanes}"
                raise InputError(path, problem, "lanes count from 0 at the kerb", key=key)
    return rsus


def _check_view(view: ViewSettings, path: Path, key: str) -> None:
    angles = view.heading_deg is not None and view.pitch_deg is not None
    some = view.heading_deg is not None or view.pitch_deg is not None
    if (view.look_at_m is None) != angles or (some and not angles):
        raise InputError(
            path,
            "where the camera looks is not clear",
            "give look_at_m, or heading_deg and pitch_deg",
            key=key,
        )


def _of_one_camera(path: Path) -> Rsu:
    """An RSU of a file of one camera; what it watches must be said in metres. Raises InputError:
    it is malformed, or leaves open which metres are watched.
    """
    one = load_rsu(path)
    stretches = []
    for watch in one.watch:
        if watch.from_m is None or watch.to_m is None:
            key = f"watch.{watch.edge}"
            raise InputError(path, "which part is watched?", "give from_m and to_m", key=key)
        stretches.append(
            WatchedStretch(
                segment=watch.edge,
                from_m=watch.from_m,
                to_m=watch.to_m,
                from_lane=watch.from_lane,
            )
        )
    if not stretches:
        raise InputError(path, "no edge is watched", "add a [[watch]]", key="watch")
    return Rsu(id=one.name, watch=tuple(stretches), mast=one.mast, view=one.view, scene=one.scene)
