"""A vehicle's tour on the telematics box's disk: what its agent goes on from after a restart."""

from __future__ import annotations

import logging
import os
from pathlib import Path
from typing import Final
from urllib.parse import quote

from slipstream.errors import InputError
from slipstream.files import read_file
from slipstream.messages import decode
from slipstream.service import LogLimiter
from vehicle_agent.tour import Tour, TourRecord

log = logging.getLogger(__name__)

_MAX_BYTES: Final = 4_000_000


class TourFile:
    """Keeps one tour in a file of a folder, written anew whenever it has changed."""

    def __init__(self, folder: Path, tour: Tour) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                folder, error.strerror or "not usable", "set another `state`"
            ) from None
        self._path = folder / f"{quote(tour.vehicle, safe='')}.json"
        self._tour = tour
        self._kept = tour.revision
        self._limiter = LogLimiter()

    def load(self) -> None:
        """Go on from the file, if there is one; a damaged one is set aside and left."""
        if not self._path.exists():
            return
        try:
            payload = read_file(self._path, _MAX_BYTES, "remove it")
            record = decode(TourRecord, payload, str(self._path))
            self._tour.resume(record)
        except (InputError, ValueError) as error:
            log.warning("the tour starts anew: %s", error)
            self._path.replace(self._path.with_suffix(".damaged"))

    def keep(self) -> None:
        """Write the tour if it has changed; a full disk is logged and survived."""
        if self._tour.revision == self._kept:
            return
        revision, record = self._tour.revision, self._tour.record()
        unfinished = self._path.with_suffix(".part")
        try:
            with unfinished.open("wb") as file:
                file.write(record.to_bytes())
                file.flush()
                os.fsync(file.fileno())
            unfinished.replace(self._path)
        except OSError as error:
            line = f"the tour of {self._tour.vehicle} is not kept over a restart: {error}"
            self._limiter.warn(log, "keep", line)
            return
        self._kept = revision
