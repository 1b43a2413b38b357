"""Each kind of file: how it is told, and what it has to be by itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from edge_daemon.settings import CameraSettings
from slipstream.config import load, read_data
from slipstream.errors import InputError, refuse
from slipstream.site import SiteSettings
from slipstream_cli.checks.clocks import clock_notes
from slipstream_cli.laboratory import part

if TYPE_CHECKING:
    from pydantic import BaseModel

    from dispatcher_daemon.fleet import Fleet
    from edge_daemon.camera import Camera
    from slipstream.roads import RoadNetwork


@dataclass(frozen=True)
class Checked:
    """A file that is valid.

    Attributes:
        path: the file.
        kind: what it is.
        notes: what else is worth knowing of it.
        unserved: stops that cannot be served, with the reason.
        fleet: of a fleet file; None: no vehicle.
    """

    path: Path
    kind: str
    notes: Sequence[str] = ()
    unserved: Mapping[str, str] = field(default_factory=dict)
    fleet: Fleet | None = None

    @property
    def title(self) -> str:
        """What it is, in words."""
        return "file of tokens" if self.kind == "tokens" else self.kind


def kind_of(path: Path) -> str:
    """What a file is, by its keys; where they leave it open, by its name.

    Raises:
        InputError: neither tells, or it cannot be read.
    """
    content = read_data(path)
    keys = set(content) if isinstance(content, dict) else set()
    if "format" in keys:
        return "instance"
    # A box has the packages of its own daemon alone, and needs no others for its own files.
    for kind, model in (("site", SiteSettings), ("camera", CameraSettings)):
        if kind in path.stem and keys <= _keys(model):
            return kind
    known = {kind: len(keys & _keys(model)) for kind, model in _models().items()}
    most = max(known.values())
    best = [kind for kind, count in known.items() if count == most and most]
    named = [kind for kind in best or CHECKS if kind in path.stem]
    for chosen in (named, best):
        if len(chosen) == 1 or (chosen and chosen is named):
            return chosen[0]
    raise InputError(
        path,
        "cannot tell what it is",
        f"say so with --as, or put {', '.join(CHECKS)} into its name",
    )


def _models() -> Mapping[str, type[BaseModel]]:
    from dispatcher_daemon.fleet import Fleet
    from dispatcher_daemon.service.api import TokenList

    return {"site": SiteSettings, "fleet": Fleet, "camera": CameraSettings, "tokens": TokenList}


def _keys(model: type[BaseModel]) -> set[str]:
    return {field.alias or name for name, field in model.model_fields.items()}


@lru_cache(maxsize=8)
def network_of(reference: str) -> RoadNetwork:
    """A road network, read once."""
    from slipstream.roads.sumo_net import load_network

    return load_network(reference)


def _check_camera(path: Path, network: str | None) -> Checked:
    from edge_daemon.camera import load_camera
    from edge_daemon.watch import read_reference

    camera = load_camera(path)
    read_reference(camera)
    if network is None:
        note = f"{path}: no roads are given: its segments are not compared with any"
        return Checked(path, "camera", (f"{note}; give --network, or the site.toml",))
    refuse(lacking(path, camera, network))
    return Checked(path, "camera")


def lacking(path: Path, camera: Camera, network: str) -> Iterator[InputError]:
    """Segments of a camera that a network has not."""
    roads = network_of(network)
    for segment in camera.segments:
        if segment.id not in roads.segments:
            problem = f"the network {network} has no such segment"
            mend = "find its id with slipstream net find"
            yield InputError(path, problem, mend, key=f"segments.{segment.id}")


def check_tokens(path: Path, _: str | None) -> Checked:
    """A file of tokens."""
    from dispatcher_daemon.service.api import TokenList

    load(path, TokenList)
    return Checked(path, "tokens")


def _check_fleet(path: Path, network: str | None) -> Checked:
    return check_fleet(path, None if network is None else network_of(network))


def check_fleet(path: Path, roads: RoadNetwork | None) -> Checked:
    """A fleet file, or the fleet that comes along; None: its roads are not known."""
    from dispatcher_daemon.fleet import FleetFile, served
    from dispatcher_daemon.forms import RoutingProblem
    from dispatcher_daemon.planning.routes import unservable
    from dispatcher_daemon.traffic import take_snapshot
    from slipstream.freshness import STALE_AFTER_S
    from slipstream.roads.snapping import NO_CLASSES, lacks_classes

    now_ns = time.time_ns()
    fleet = FleetFile(str(path), roads).current(now_ns)
    notes = () if fleet is None else clock_notes(path, fleet, now_ns)
    if roads is None:
        lacking = "its roads are not known: its places and the ways to its stops are not checked"
        mend = "give --network, or its site.toml beside it"
        return Checked(path, "fleet", notes=(*notes, f"{path}: {lacking}; {mend}"), fleet=fleet)
    if fleet is None:
        return Checked(path, "fleet")
    places = [f"{path}: {place}" for place in served(fleet, roads)]
    if places and lacks_classes(roads):
        places.append(f"{path}: {NO_CLASSES}")
    notes = (*notes, *places)
    if not fleet.stops:
        return Checked(path, "fleet", notes=notes, fleet=fleet)
    free_flow = take_snapshot(roads, (), 0, stale_after_s=STALE_AFTER_S)
    unserved = unservable(RoutingProblem(roads, fleet), free_flow)
    return Checked(path, "fleet", notes=notes, unserved=unserved, fleet=fleet)


def _check_instance(path: Path, _: str | None) -> Checked:
    return Checked(path, "instance", unserved=part("check-instance", f"{path}: an instance")(path))


CHECKS: Final[dict[str, Callable[[Path, str | None], Checked]]] = {
    "camera": _check_camera,
    "tokens": check_tokens,
    "fleet": _check_fleet,
    "instance": _check_instance,
}
"""Each checks one file, a fleet's or a camera's on given roads; None: they are not known."""
