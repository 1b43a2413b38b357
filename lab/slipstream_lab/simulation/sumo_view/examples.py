"""The example that comes with the package: a net, routes and RSUs, chosen by name."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from slipstream.errors import InputError

NETS = ("avenue",)
ROUTES = ("calm", "mixed", "rough")
RSUS = ("approach", "bend", "crossing", "departure", "opposite")


def find_net(name: str) -> Path:
    """Path of a net: a built-in name or the user's file."""
    return _find(name, NETS, "net.xml", "net")


def find_routes(name: str) -> Path:
    """Path of a route file: a built-in name or the user's file."""
    return _find(name, ROUTES, "rou.xml", "routes")


def find_rsu(name: str) -> Path:
    """Path of an RSU file: a built-in name or the user's file."""
    return _find(name, RSUS, "rsu.toml", "rsu")


def find_additional(routes: str, files: list[Path]) -> tuple[Path, ...]:
    """Additional files: the user's, and those that belong to built-in routes."""
    for path in files:
        _must_be(path)
    own = _folder() / f"{routes}.add.xml"
    return (*([own] if routes in ROUTES and own.is_file() else []), *files)


def _folder() -> Path:
    return Path(str(resources.files("slipstream_lab.simulation.sumo_view") / "data"))


def _find(name: str, names: tuple[str, ...], suffix: str, what: str) -> Path:
    if name in names:
        return _folder() / f"{name}.{suffix}"
    path = Path(name)
    if not path.exists():
        built_in = ", ".join(names)
        raise InputError(path, "no such file", f"give a file, or built-in {what}: {built_in}")
    _must_be(path)
    return path


def _must_be(path: Path) -> None:
    try:
        with path.open("rb"):
            return
    except OSError as error:
        raise InputError(path, error.strerror or "not readable", "check the path") from None
