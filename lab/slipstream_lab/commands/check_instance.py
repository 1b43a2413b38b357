"""`slipstream check` of an instance's file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from slipstream.config import read_data


def check_instance(path: Path) -> Mapping[str, str]:
    """Check one file; stops that cannot be served, with the reason. Raises InputError: it is no
    instance.
    """
    from dispatcher_daemon.planning.routes import unservable
    from slipstream_lab.research.instances.instance import instance_from
    from slipstream_lab.research.instances.matrices import has_matrices, matrix_instance_from

    data = read_data(path)
    if has_matrices(data):
        matrix_instance_from(data, path)
        return {}
    instance = instance_from(data, path)
    return unservable(instance.problem, instance.snapshot)
