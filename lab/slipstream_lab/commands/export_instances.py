"""`slipstream export instance`: instances in the formats of benchmark libraries and solvers."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from slipstream.config import read_data
from slipstream.errors import InputError

if TYPE_CHECKING:
    from slipstream_lab.research.instances.instance import Instance

_PACKAGE: Final = "qoblib"
FORMATS: Final = (_PACKAGE, "lp", "mps", "qs")
_ALL: Final = "all"
_ONLY_FOR_TABLES: Final = {"begin": "--from", "end": "--to"}


def run(options: argparse.Namespace) -> int:
    """Write the files; all instances are read before the first is written."""
    for name, option in _ONLY_FOR_TABLES.items():
        if getattr(options, name) is not None:
            raise InputError("export", "only for tables", "leave it out", key=option)
    chosen = options.format or _PACKAGE
    if chosen not in FORMATS:
        mend = f"take one of {', '.join(FORMATS)}"
        raise InputError("export", f"{chosen} is for tables", mend, key="--format")
    instances = _instances(options.names)
    out: Path = options.out
    if out.exists() and not out.is_dir():
        raise InputError(out, "is no folder", "give a folder", key="--out")
    if out.exists() and any(out.iterdir()) and not options.force:
        raise InputError(out, "is not empty", "give --force, or another --out", key="--out")
    try:
        paths = _write(instances, chosen, out)
    except OSError as error:
        problem = error.strerror or "not writable"
        raise InputError(out, problem, "give another folder", key="--out") from None
    if options.json:
        print(json.dumps({"instances": len(instances), "files": [str(path) for path in paths]}))
    else:
        print(f"{out}: {len(instances)} instances, {len(paths)} files")
    return 0


def _instances(names: Sequence[str]) -> list[Instance]:
    from slipstream_lab.research.instances import instance_names, open_instance
    from slipstream_lab.research.instances.matrices import has_matrices
    from slipstream_lab.research.instances.package import file_name

    if not names:
        mend = "name them, or 'all' for the published ones"
        raise InputError("export", "no instance", mend, key="instance")
    found: dict[str, Instance] = {}
    for name in dict.fromkeys(n for given in names for n in _expanded(given, instance_names())):
        path = Path(name)
        if name not in instance_names() and path.suffix and has_matrices(read_data(path)):
            mend = "take an instance with roads"
            raise InputError(path, "matrices have no roads to platoon on", mend, key="matrix")
        instance = open_instance(name)
        if file_name(instance) in found:
            problem = f"an instance before it is called {instance.name!r} too"
            raise InputError(name, problem, "export it by itself", key="name")
        found[file_name(instance)] = instance
    return list(found.values())


def _expanded(name: str, published: Sequence[str]) -> Sequence[str]:
    return published if name == _ALL else (name,)


def _write(instances: Sequence[Instance], chosen: str, out: Path) -> Sequence[Path]:
    from slipstream_lab.research.instances.package import file_name, write_model, write_package

    out.mkdir(parents=True, exist_ok=True)
    if chosen == _PACKAGE:
        return write_package(instances, out)
    paths = [out / f"{file_name(instance)}.{chosen}" for instance in instances]
    for instance, path in zip(instances, paths, strict=True):
        write_model(instance, path)
    return paths
