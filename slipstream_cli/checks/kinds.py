"""Each kind of file: how it is told, and what it has to be by itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final

from pydantic import create_model

from slipstream.config import check, load, read_data
from slipstream.errors import InputError
from slipstream_cli.checks.clocks import clock_notes
from slipstream_cli.laboratory import part

if TYPE_CHECKING:
    from pydantic import BaseModel

    from slipstream.roads import RoadNetwork

_BOXES: Final = (
    ("agent", "vehicle_agent.settings", "AgentSettings"),
    ("edge", "edge_daemon.settings", "EdgeSettings"),
    ("camera", "edge_daemon.settings", "CameraSettings"),
)
"""Models of what is checked on boxes, which have no dispatcher."""


@dataclass(frozen=True)
class Checked:
    """A file that is valid by itself, or the valid keys of one that is not.

    Attributes:
        path: the file.
        kind: what it is.
        content: settings or camera; of a file that is not valid, what `part_of` found.
        notes: what else is worth knowing of it.
        unserved: stops that cannot be served, with the reason.
        fleet: of a fleet file, or the one that a dispatcher's settings name; None: no vehicle, or
            not to be read.
        whole: it is valid.
    """

    path: Path
    kind: str
    content: Any = None
    notes: Sequence[str] = ()
    unserved: Mapping[str, str] = field(default_factory=dict)
    fleet: Any = None
    whole: bool = True

    @property
    def title(self) -> str:
        """What it is, in words."""
        alone = ("fleet", "instance", "camera")
        if self.kind == "tokens":
            return "file of tokens"
        return self.kind if self.kind in alone else f"{self.kind} settings"


def kind_of(path: Path) -> str:
    """What a file is, by its keys; where they leave it open, by its name.

    Raises:
        InputError: neither tells, or it cannot be read.
    """
    content = read_data(path)
    keys = set(content) if isinstance(content, dict) else set()
    if "format" in keys:
        return "instance"
    # A box has the packages of its own daemon alone.
    for kind, module, name in _BOXES:
        if kind in path.stem and keys <= _keys(getattr(import_module(module), name)):
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


_PART_BYTES: Final = 2 << 20
"""Larger files that are not valid are not compared with others: a list of millions of wrong items
takes gigabytes to read once more."""


def part_of(path: Path, kind: str) -> Checked | None:
    """What can be read of a file that is not valid; None: nothing.

    Its content has each key of the model that is valid by itself, or not given and has a default.
    Keys that are not valid, or missing, are no attributes of it.
    """
    try:
        if path.stat().st_size > _PART_BYTES:
            return None
        data = read_data(path)
    except (InputError, OSError):
        return None
    models = {name: getattr(import_module(module), model) for name, module, model in _BOXES}
    # A box has the packages of its own daemon alone.
    model = models.get(kind) or _models().get(kind)
    if model is None or not isinstance(data, dict):
        return None
    content = SimpleNamespace()
    for name, info in model.model_fields.items():
        key = info.alias or name
        if key not in data:
            if not info.is_required():
                setattr(content, name, info.get_default(call_default_factory=True))
            continue
        # A field's own model: validators of the whole one need all keys.
        fields: dict[str, Any] = {name: (info.annotation, info)}
        part = create_model("Part", **fields)
        try:
            setattr(content, name, getattr(check({key: data[key]}, part, path), name))
        except InputError:
            continue
    fleet: Any = None
    if kind == "fleet":
        fleet = content if hasattr(content, "vehicles") else None
    elif kind == "dispatcher" and getattr(content, "fleet", None):
        named = part_of(Path(content.fleet), "fleet")
        fleet = None if named is None else named.fleet
    return Checked(path, kind, content, fleet=fleet, whole=False)


def _models() -> Mapping[str, type[BaseModel]]:
    from dispatcher_daemon.fleet import Fleet
    from dispatcher_daemon.service.api import TokenList
    from edge_daemon.settings import CameraSettings
    from slipstream_cli.settings_doc import DAEMONS

    return {"fleet": Fleet, "camera": CameraSettings, "tokens": TokenList, **DAEMONS}


def _keys(model: type[BaseModel]) -> set[str]:
    return {field.alias or name for name, field in model.model_fields.items()}


@lru_cache(maxsize=8)
def network_of(reference: str) -> RoadNetwork:
    """A road network, read once."""
    from slipstream.sumo_net import load_network

    return load_network(reference)


def _check_edge(path: Path, _: str | None) -> Checked:
    from edge_daemon.camera import load_camera
    from edge_daemon.detection import open_detector
    from edge_daemon.settings import EdgeSettings
    from edge_daemon.sources.clip import open_clip
    from edge_daemon.watch import read_reference

    settings = load(path, EdgeSettings)
    camera = load_camera(settings.camera)
    read_reference(camera)
    open_detector(settings.detector)
    if settings.source.clips:
        source = settings.source
        open_clip(*source.clips, loop=False, size=camera.size, fps=source.fps).close()
    return Checked(path, "edge", settings)


def _check_camera(path: Path, _: str | None) -> Checked:
    from edge_daemon.camera import load_camera
    from edge_daemon.watch import read_reference

    camera = load_camera(path)
    read_reference(camera)
    return Checked(path, "camera", camera)


def _check_dispatcher(path: Path, _: str | None) -> Checked:
    from dispatcher_daemon.settings import DispatcherSettings
    from slipstream.admission import check_rsus

    settings = load(path, DispatcherSettings)
    roads = network_of(settings.network)
    check_rsus(settings.rsus, roads, path)
    service, _, device = settings.hardware.backend.partition(":")
    if service == "fake":
        from dispatcher_daemon.solvers.quantum.backends import fake_target

        try:
            fake_target(device)
        except InputError as error:
            raise InputError(path, error.problem, error.mend, key="hardware.backend") from None
    tokens = settings.api.tokens
    if tokens is not None and tokens.name != str(tokens):
        # A plain name is mostly one of systemd's, which is not here.
        _check_tokens(tokens, None)
    fleet = _fleet(Path(settings.fleet), roads)
    return Checked(path, "dispatcher", settings, fleet.notes, fleet.unserved, fleet.fleet)


def _check_agent(path: Path, _: str | None) -> Checked:
    from vehicle_agent.settings import AgentSettings

    return Checked(path, "agent", load(path, AgentSettings))


def _check_dashboard(path: Path, _: str | None) -> Checked:
    from dashboard.settings import DashboardSettings
    from dashboard.web.fleet_file import make_scene
    from slipstream.admission import check_rsus

    settings = load(path, DashboardSettings)
    roads = network_of(settings.network)
    check_rsus(settings.rsus, roads, path)
    make_scene(roads, settings.fleet, settings.depots)
    return Checked(path, "dashboard", settings)


def _check_scheduler(path: Path, _: str | None) -> Checked:
    from dispatcher_daemon.settings import SchedulerSettings

    return Checked(path, "scheduler", load(path, SchedulerSettings))


def _check_worker(path: Path, _: str | None) -> Checked:
    from dispatcher_daemon.settings import WorkerSettings

    return Checked(path, "worker", load(path, WorkerSettings))


def _check_tokens(path: Path, _: str | None) -> Checked:
    from dispatcher_daemon.service.api import TokenList

    return Checked(path, "tokens", load(path, TokenList))


def _check_fleet(path: Path, network: str | None) -> Checked:
    return _fleet(path, None if network is None else network_of(network))


def _fleet(path: Path, roads: RoadNetwork | None) -> Checked:
    from dispatcher_daemon.fleet import FleetFile, served
    from dispatcher_daemon.forms import RoutingProblem
    from dispatcher_daemon.planning.routes import unservable
    from dispatcher_daemon.traffic import take_snapshot
    from slipstream.freshness import STALE_AFTER_S
    from slipstream.snapping import NO_CLASSES, lacks_classes

    now_ns = time.time_ns()
    fleet = FleetFile(str(path), roads).current(now_ns)
    notes = () if fleet is None else clock_notes(path, fleet, now_ns)
    if roads is None:
        lacking = "its roads are not known: its places and the ways to its stops are not checked"
        mend = "give --network, or its dispatcher's settings beside it"
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
    "edge": _check_edge,
    "dispatcher": _check_dispatcher,
    "agent": _check_agent,
    "dashboard": _check_dashboard,
    "scheduler": _check_scheduler,
    "worker": _check_worker,
    "camera": _check_camera,
    "tokens": _check_tokens,
    "fleet": _check_fleet,
    "instance": _check_instance,
}
"""Each checks one file, a fleet's on given roads; None: they are not known."""
