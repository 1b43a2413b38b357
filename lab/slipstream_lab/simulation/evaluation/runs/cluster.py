"""Arms on the machines of a cluster, each in a process of a worker; what is lost runs again."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import TimeoutError
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.settings import ClusterSettings
from dispatcher_daemon.solvers.cluster import CallFailed, Cluster, ClusterLost
from slipstream.errors import InputError
from slipstream_lab.simulation.closed_loop.arm import ArmSpec, run_arm, simulate_arm
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.runs.provenance import code_stamp
from slipstream_lab.simulation.sumo import Progress, check_files

log = logging.getLogger(__name__)

Contents = npt.NDArray[np.uint8]

_TRIES: Final = 3
"""On the cluster; then this machine simulates the arm."""
_JOIN_S: Final = 120.0
"""Time in which the first worker has to be ready, or another one after the last was lost."""
_LIMIT_S: Final = 7 * 86_400.0
"""For an arm: only one that hangs takes longer."""
_LOOK_S: Final = 0.5


@contextmanager
def arms_on(settings: ClusterSettings) -> Iterator[ArmsOnCluster]:
    """A connection for a with statement. Raises InputError: a TLS file cannot be used, the extra
    is not installed, or no worker is ready.
    """
    cluster = Cluster(settings, processes=0, functions=(simulate_sent,))
    try:
        if not cluster.wait_for(1, _JOIN_S):
            raise InputError(
                str(settings.address),
                f"no worker of the same build is ready after {_JOIN_S:g} s",
                "start `slipstream worker` there, from the same sources",
            )
        yield ArmsOnCluster(cluster)
    finally:
        cluster.close()


class ArmsOnCluster:
    """Simulates arms as `run_arm` does, with the same result."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster

    @property
    def processes(self) -> int:
        """How many arms run at once."""
        return max(1, self._cluster.slots)

    def run(self, order: ArmSpec, progress: Progress) -> ArmResult:
        """Simulate an arm; its progress is told when it ends. Raises InputError: as `run_arm`, or
        a worker cannot simulate.
        """
        sent, contents = _with_contents(order)
        for _ in range(_TRIES):
            try:
                return self._ask(order, sent, contents, progress)
            except ClusterLost as error:
                log.warning("arm %s, seed %d: %s", order.policy.name, order.seed, error)
                if not self._cluster.wait_for(1, _JOIN_S):
                    break
        log.warning("arm %s, seed %d: simulated here", order.policy.name, order.seed)
        return run_arm(order, progress)

    def _ask(
        self, order: ArmSpec, sent: ArmSpec, contents: Sequence[Contents], progress: Progress
    ) -> ArmResult:
        arguments = code_stamp(), sent, tuple(contents)
        future = self._cluster.submit(simulate_sent, arguments, _LIMIT_S, _LIMIT_S)
        while True:
            try:
                answer = future.result(_LOOK_S)
            except TimeoutError:
                if future.done():
                    raise ClusterLost(f"no end after {_LIMIT_S:g} s") from None
                # Raises where the evaluation was stopped.
                progress(order.begin_s, order.end_s)
                continue
            except CallFailed as error:
                mend = "look at its log; it needs the same sources and the extra 'sim'"
                raise InputError("a worker of the cluster", str(error), mend) from None
            if isinstance(answer, InputError):
                raise answer
            assert isinstance(answer, ArmResult)
            return answer


def simulate_sent(
    stamp: str, order: ArmSpec, contents: Sequence[Contents]
) -> ArmResult | InputError:
    """Simulate an arm in this process, a worker's.

    Args:
        order: its paths are names of what is in `contents`, in the order of `_paths`.

    Returns:
        the result; or what `simulate_arm` refused the files for.

    Raises:
        ValueError: the sources here are others than the sender's.
    """
    if stamp != code_stamp():
        raise ValueError(f"it has {code_stamp()}, and {stamp} is asked for")
    with tempfile.TemporaryDirectory(prefix="slipstream-arm-") as name:
        folder = Path(name)
        paths = [folder / path for path in _paths(order)]
        for path, content in zip(paths, contents, strict=True):
            path.write_bytes(content.tobytes())
        placed = _with_paths(order, paths)
        try:
            return simulate_arm(placed, lambda _: None)
        except InputError as error:
            return error


def _paths(order: ArmSpec) -> list[Path]:
    single = (order.net, order.fleet, order.history)
    return [*order.background, *order.additional, *(path for path in single if path is not None)]


def _with_paths(order: ArmSpec, paths: Sequence[Path]) -> ArmSpec:
    """The order with other paths in the order of `_paths`."""
    left = iter(paths)
    return replace(
        order,
        background=tuple(next(left) for _ in order.background),
        additional=tuple(next(left) for _ in order.additional),
        net=None if order.net is None else next(left),
        fleet=None if order.fleet is None else next(left),
        history=None if order.history is None else next(left),
    )


def _with_contents(order: ArmSpec) -> tuple[ArmSpec, list[Contents]]:
    """The order with names in place of paths, and what stands in the files.

    Arrays, not bytes: those are sent once for all arms.
    """
    paths = _paths(order)
    if order.net is not None:
        check_files(order.net, (*order.background, *order.additional))
    names = [Path(f"{number}-{path.name}") for number, path in enumerate(paths)]
    contents = [np.frombuffer(path.read_bytes(), np.uint8) for path in paths]
    return _with_paths(order, names), contents
