"""Names that are gathered while the work on others goes on, on a thread of its own."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Collection, Iterable
from typing import Self

log = logging.getLogger(__name__)


class Gathering:
    """Calls a function with names soon after they were put in, with all that came while it ran; a
    context manager.

    Args:
        work: what it raises is logged and survived.
    """

    def __init__(self, name: str, work: Callable[[Collection[str]], None]) -> None:
        self._work = work
        self._waiting: dict[str, None] = {}
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, names: Iterable[str]) -> None:
        """Have the work done for some; returns at once."""
        with self._changed:
            self._waiting.update(dict.fromkeys(names))
            self._changed.notify()

    def close(self) -> None:
        """End the thread after what it is at; what waits is let go."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed)
                if self._closed:
                    return
                names, self._waiting = self._waiting, {}
            try:
                self._work(names)
            except Exception:
                log.exception("%s failed", self._thread.name)
