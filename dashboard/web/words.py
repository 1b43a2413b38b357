"""Stored cycles in words, for cards."""

from __future__ import annotations

import logging
from functools import lru_cache
from typing import Final

from slipstream.explain import Explanation, explanation
from storage import Reader

log = logging.getLogger(__name__)

KEPT: Final = 16
"""Cycles whose words are kept: a card that is looked at is asked for again each few seconds."""


class Words:
    """The words of stored cycles; from any thread."""

    def __init__(self, reader: Reader | None) -> None:
        self._reader = reader
        self._kept = lru_cache(KEPT)(self._read)

    def of_cycle(self, cycle: int, told_ns: int) -> Explanation | None:
        """A cycle in words; None: it is not stored, or not as this version reads it.

        Args:
            cycle: its number.
            told_ns: UTC of what it is asked for by: a database that was replaced may have another
                cycle of the number.

        Raises:
            StorageError: the database cannot be read.
        """
        try:
            return self._kept(cycle, told_ns)
        except LookupError:
            return None
        except ValueError as error:
            log.warning("cycle %d cannot be told in words: %s", cycle, error)
            return None

    def _read(self, cycle: int, told_ns: int) -> Explanation:
        report = None if self._reader is None else self._reader.cycle(cycle)
        if self._reader is None or report is None:
            # Raised, as it is not kept: the cycle may be stored in a moment.
            raise LookupError(cycle)
        return explanation(report, self._reader.plans(cycle), self._reader.cycle_record(cycle))
