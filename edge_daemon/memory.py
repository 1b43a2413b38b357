"""The sightings of the last frames, kept so that asking for all of them costs little."""

from __future__ import annotations

from collections import deque

from edge_daemon.tracking import Sightings


class Memory:
    """Sightings, frame by frame; what was joined once stays joined."""

    def __init__(self) -> None:
        self._parts: deque[Sightings] = deque()
        self._frames: deque[tuple[float, int]] = deque()
        self._forgotten = 0

    def add(self, sightings: Sightings) -> None:
        """Remember a frame's sightings, the latest of them last."""
        if len(sightings):
            self._parts.append(sightings)
            self._frames.append((float(sightings.time_s[-1]), len(sightings)))

    def forget(self, before_s: float) -> None:
        """Drop the frames whose latest sighting is older than a media time."""
        while self._frames and self._frames[0][0] < before_s:
            self._forgotten += self._frames.popleft()[1]
        while self._parts and len(self._parts[0]) <= self._forgotten:
            self._forgotten -= len(self._parts.popleft())

    def all(self) -> Sightings | None:
        """All that is remembered, in order of its frames; None if there is nothing."""
        if not self._parts:
            return None
        joined = Sightings.join(self._parts).take(slice(self._forgotten, None))
        self._parts, self._forgotten = deque([joined]), 0
        return joined
