"""What files of one site have to agree about. Pure, but for nets that are read once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from slipstream.errors import InputError
from slipstream_cli.checks.kinds import Checked, kind_of, network_of, part_of


def faults_between(files: Sequence[Checked], network: str | None) -> Iterator[InputError]:
    """What does not fit together.

    Args:
        files: each valid by itself, or its valid keys; what has no key to compare is passed over.
        network: roads that are given beside them; None: those of the dispatchers, or else of the
            dashboards.
    """
    by_kind: dict[str, list[Checked]] = {}
    for file in files:
        by_kind.setdefault(file.kind, []).append(file)
    yield from _rsus(by_kind)
    yield from _segments(by_kind, network)
    yield from _dashboards(by_kind)
    yield from _prices(by_kind)
    yield from _vehicles(by_kind)
    yield from _ports(files)


def nets_of(files: Mapping[str, Sequence[Checked]], network: str | None) -> dict[str, str]:
    """The road networks of a site, and who names them."""
    if network is not None:
        return {network: "--network"}
    owners = files.get("dispatcher") or files.get("dashboard") or ()
    return {
        owner.content.network: str(owner.path)
        for owner in owners
        if hasattr(owner.content, "network")
    }


def roads_of(
    fleet: Path, owners: Mapping[str, Sequence[Checked]], network: str | None
) -> str | None:
    """The roads that a fleet file is for; None: nobody says.

    Those that are given; else of the settings among the files that name it, or of the first ones;
    else of the settings in its folder that name it.
    """
    named = nets_of(owners, network)
    if network is not None:
        return network
    for owner in (*owners.get("dispatcher", ()), *owners.get("dashboard", ())):
        if _names(owner, fleet) and hasattr(owner.content, "network"):
            return str(owner.content.network)
    if named:
        return next(iter(named))
    for path in sorted(fleet.absolute().parent.glob("*.toml")):
        try:
            kind = kind_of(path) if path.absolute() != fleet.absolute() else None
        except InputError:
            continue
        beside = part_of(path, kind) if kind in ("dispatcher", "dashboard") else None
        if beside is not None and _names(beside, fleet) and hasattr(beside.content, "network"):
            return _beside(path, beside.content.network)
    return None


def _names(owner: Checked, fleet: Path) -> bool:
    """Whether settings name a fleet file, from here or from their folder."""
    named = getattr(owner.content, "fleet", None)
    if named is None:
        return False
    return fleet.absolute() in (Path(named).absolute(), owner.path.absolute().parent / named)


def _beside(settings: Path, network: str) -> str:
    """A network that settings name, from here or from their folder."""
    beside = settings.parent / network
    return network if Path(network).exists() or not beside.exists() else str(beside)


def _with(files: Mapping[str, Sequence[Checked]], kind: str, *keys: str) -> list[Checked]:
    """Files of a kind of which these keys are known."""
    return [f for f in files.get(kind, ()) if all(hasattr(f.content, key) for key in keys)]


def _camera(path: Path) -> tuple[Checked | None, Sequence[InputError]]:
    """(a camera that an edge's settings name, or its valid keys; what is wrong with it)."""
    from edge_daemon.camera import load_camera

    try:
        return Checked(path, "camera", load_camera(path)), ()
    except InputError as error:
        return part_of(path, "camera"), (error, *error.others)


def _rsus(files: Mapping[str, Sequence[Checked]]) -> Iterator[InputError]:
    """RSUs named twice, and those that the dispatcher does not admit."""
    seen: dict[str, Path] = {}
    for edge in _with(files, "edge", "rsu"):
        rsu = edge.content.rsu
        if rsu in seen:
            problem = f"{rsu!r} is also the name in {seen[rsu]}"
            yield InputError(edge.path, problem, "give each its own", key="rsu")
        seen.setdefault(rsu, edge.path)
        camera = _camera(Path(edge.content.camera))[0] if hasattr(edge.content, "camera") else None
        watched = [s.id for s in getattr(camera and camera.content, "segments", ())]
        for dispatcher in _with(files, "dispatcher", "rsus"):
            listed: Mapping[str, Sequence[str]] | None = dispatcher.content.rsus
            if listed is None:
                continue
            if rsu not in listed:
                problem = f"{dispatcher.path} does not list {rsu!r} in rsus"
                yield InputError(edge.path, problem, "add it there, or rename one", key="rsu")
                continue
            for segment in watched:
                if segment not in listed[rsu]:
                    yield InputError(
                        edge.content.camera,
                        f"{dispatcher.path} does not list it for {rsu!r}",
                        "add it to rsus there, or remove it here",
                        key=f"segments.{segment}",
                    )


def _segments(files: Mapping[str, Sequence[Checked]], network: str | None) -> Iterator[InputError]:
    """Segments of cameras that the roads lack."""
    cameras = {
        camera.path.absolute(): camera.content for camera in _with(files, "camera", "segments")
    }
    for edge in _with(files, "edge", "camera"):
        path = Path(edge.content.camera).absolute()
        if path not in cameras:
            camera, faults = _camera(path)
            yield from faults
            if camera is not None and hasattr(camera.content, "segments"):
                cameras[path] = camera.content
    if not cameras:
        return
    for reference, owner in nets_of(files, network).items():
        try:
            roads = network_of(reference)
        except InputError as error:
            yield error
            continue
        for path, content in cameras.items():
            for segment in content.segments:
                if segment.id not in roads.segments:
                    yield InputError(
                        path,
                        f"the network of {owner} has no such segment",
                        "find its id with slipstream net find",
                        key=f"segments.{segment.id}",
                    )


def _dashboards(files: Mapping[str, Sequence[Checked]]) -> Iterator[InputError]:
    """Roads and RSUs that a dashboard shows, and its dispatcher does not use."""
    for dashboard in files.get("dashboard", ()):
        for dispatcher in files.get("dispatcher", ()):
            for key in ("network", "rsus", "database_url", "fleet"):
                if not (hasattr(dashboard.content, key) and hasattr(dispatcher.content, key)):
                    continue
                if key == "fleet" and dashboard.content.fleet is None:
                    continue
                if _plain(dashboard, key) != _plain(dispatcher, key):
                    yield InputError(
                        dashboard.path,
                        f"not the same as in {dispatcher.path}",
                        "write the dispatcher's",
                        key=key,
                    )


def _prices(files: Mapping[str, Sequence[Checked]]) -> Iterator[InputError]:
    """A kilowatt hour that the page counts at another price than routes are weighed by."""
    for dashboard in _with(files, "dashboard", "price_per_kwh"):
        for dispatcher in _with(files, "dispatcher", "prices"):
            price = dispatcher.content.prices.energy_kwh
            if dashboard.content.price_per_kwh != price:
                problem = f"{price:g} in {dispatcher.path}, where it is prices.energy_kwh"
                mend = "give both the same"
                yield InputError(dashboard.path, problem, mend, key="price_per_kwh")


def _plain(file: Checked, key: str) -> Any:
    value = getattr(file.content, key)
    if key == "rsus":
        return None if value is None else {rsu: set(found) for rsu, found in value.items()}
    return Path(value).absolute() if key in ("network", "fleet") else value


def _vehicles(files: Mapping[str, Sequence[Checked]]) -> Iterator[InputError]:
    """Vehicles with two agents, and those that no fleet has."""
    owners = (*files.get("fleet", ()), *files.get("dispatcher", ()))
    known = {vehicle.id for f in owners if f.fleet is not None for vehicle in f.fleet.vehicles}
    if any(f.fleet is None and not f.whole for f in owners):
        # Vehicles that cannot be read may be anybody.
        known = set()
    seen: dict[str, Path] = {}
    for agent in _with(files, "agent", "vehicles"):
        for vehicle in agent.content.vehicles:
            key = f"vehicles.{vehicle.id}"
            if vehicle.id in seen:
                problem = f"{seen[vehicle.id]} has an agent of it too"
                yield InputError(agent.path, problem, "remove it from one", key=key)
            seen.setdefault(vehicle.id, agent.path)
            if known and vehicle.id not in known:
                problem = "no fleet file has this vehicle"
                yield InputError(agent.path, problem, "add it there, or mend its id", key=key)


def _ports(files: Sequence[Checked]) -> Iterator[InputError]:
    """Ports that two files of one machine ask for: of those whose router is on their machine."""
    seen: dict[int, tuple[Path, str]] = {}
    for file in filter(_beside_the_router, files):
        for key, port in _ports_of(file):
            if port in seen:
                path, other = seen[port]
                whose = other if path == file.path else f"{other} of {path}"
                problem = f"port {port} is taken by {whose}"
                yield InputError(file.path, problem, "give each its own", key=key)
            seen.setdefault(port, (file.path, key))


def _beside_the_router(file: Checked) -> bool:
    bus = getattr(file.content, "bus", None)
    return bus is None or any("/127." in end or "/localhost:" in end for end in bus.connect)


def _ports_of(file: Checked) -> Iterator[tuple[str, int]]:
    content = file.content
    service = getattr(content, "service", None)
    api = getattr(content, "api", None)
    named = {
        "port": getattr(content, "port", 0) if file.kind in ("dashboard", "worker") else 0,
        "scene_port": getattr(content, "scene_port", 0),
        "api.port": 0 if api is None else api.port,
        "service.metrics_port": 0 if service is None else service.metrics_port,
    }
    yield from ((key, port) for key, port in named.items() if port)
