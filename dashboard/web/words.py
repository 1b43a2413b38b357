"""Stored cycles in words, for cards."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from typing import Final

from slipstream.explain import Explanation, explanation
from storage import Reader

log = logging.getLogger(__name__)

KEPT: Final = 16
"""Cycles whose words are kept: a card that is looked at is asked for again each few seconds."""


class Words:
    """The words of stored cycles; from any thread.

    Args:
        reader: of the database; None: there is none.
    """

    def __init__(self, reader: Reader | None) -> None:
        self._reader = reader
        self._lock = threading.Lock()
        self._kept: OrderedDict[tuple[int, int], Explanation] = OrderedDict()

    def of_cycle(self, cycle: int, told_ns: int) -> Explanation | None:
        """A cycle in words; None: it is not stored, or by a version that this one cannot read.

        Args:
            cycle: its number.
            told_ns: UTC of what it is asked for by: a database that was replaced may have another
                cycle of the number.

        Raises:
            StorageError: the database cannot be read.
        """
        key = cycle, told_ns
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
            found = self._read(cycle)
            if found is not None:
                self._kept[key] = found
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            return found

    def _read(self, cycle: int) -> Explanation | None:
        report = None if self._reader is None else self._reader.cycle(cycle)
        if self._reader is None or report is None:
            return None
        try:
            record = self._reader.cycle_record(cycle)
            return explanation(report, self._reader.plans(cycle), record)
        except ValueError as error:
            log.warning("cycle %d cannot be told in words: %s", cycle, error)
            return None
