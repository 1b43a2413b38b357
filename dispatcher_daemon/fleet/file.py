"""A fleet file that other programs rewrite while the dispatcher runs."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from dispatcher_daemon.fleet.loading import DEMO_FLEET, fleet_from, load_fleet
from dispatcher_daemon.fleet.models import Fleet
from slipstream.config import read_data
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork


class FleetFile:
    """A fleet that is read again whenever its file has changed.

    Writers should write another file and rename it, so that no partial file is read.

    Args:
        network: roads that it must fit; None: they are not known.

    Raises:
        InputError: the file is missing or faulty.
    """

    def __init__(self, reference: str, network: RoadNetwork | None) -> None:
        self._path = None if reference == DEMO_FLEET else Path(reference)
        self._network = network
        self._fleet = load_fleet(reference, network) if self._path is None else self._read()
        self._stamp: tuple[int, int, int] | None = None

    def current(self, reference_ns: int | None = None) -> Fleet | None:
        """The fleet now; None if the file has no vehicle. Its stops may be none: orders may come
        otherwise.

        Args:
            reference_ns: UTC that its times count from, which makes its clock times seconds; None:
                now.

        Raises:
            InputError: the file is gone or faulty; the last good one is not dispatched again, as
                its orders may be served.
        """
        fleet = self._fleet if self._path is None else self._latest(self._path)
        return None if fleet is None else fleet.at(reference_ns or time.time_ns())

    def _latest(self, path: Path) -> Fleet | None:
        try:
            found = path.stat()
        except OSError as error:
            problem = error.strerror or "not readable"
            raise InputError(path, problem, "write it again") from None
        stamp = found.st_mtime_ns, found.st_size, found.st_ino
        if stamp != self._stamp:
            self._fleet = self._read()
            self._stamp = stamp
        return self._fleet

    def _read(self) -> Fleet | None:
        assert self._path is not None
        data = read_data(self._path)
        if isinstance(data, Mapping) and data.get("vehicles") == []:
            return None
        return fleet_from(
            data, self._network, self._path, may_lack_stops=True, may_have_clock_times=True
        )
