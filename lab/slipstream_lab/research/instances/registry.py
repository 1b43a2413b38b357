"""Instances by name: those that are published with the package, or any instance file."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from slipstream.errors import InputError
from slipstream_lab.research.instances.instance import Instance, load_instance

_SUFFIX = ".json"


def instance_names() -> tuple[str, ...]:
    """Names of the published instances, in order."""
    folder = resources.files("slipstream_lab.research.instances") / "files"
    names = (item.name for item in folder.iterdir())
    return tuple(sorted(name.removesuffix(_SUFFIX) for name in names if name.endswith(_SUFFIX)))


def open_instance(reference: str | Path) -> Instance:
    """Read a published instance by name, or an instance file by path. Raises InputError: there is
    neither, or the file is faulty (see `load_instance`).
    """
    if str(reference) in instance_names():
        folder = resources.files("slipstream_lab.research.instances") / "files"
        with resources.as_file(folder / f"{reference}{_SUFFIX}") as path:
            return load_instance(path)
    path = Path(reference)
    if path.suffix == "" and not path.exists():
        raise InputError(
            str(reference),
            "no instance of this name",
            "see slipstream solve --list, or give a file",
        )
    return load_instance(path)
