"""Dates with a time of day as ISO 8601 writes them, 24:00 too."""

from __future__ import annotations

import re
from datetime import datetime, timedelta
from typing import Final

_END_OF_DAY: Final = re.compile(r"([T ])24(:?00(?::?00(?:[.,]0+)?)?)(?![\d:])", re.IGNORECASE)


def read_datetime(text: str) -> datetime:
    """Read it; 24:00 is 00:00 of the day after.

    Raises:
        ValueError: it is none.
    """
    begin = _END_OF_DAY.sub(r"\g<1>00\2", text)
    at = datetime.fromisoformat(begin)
    try:
        return at if begin == text else at + timedelta(days=1)
    except OverflowError as error:
        raise ValueError(str(error)) from None
