"""Log lines as JSON: one object a line, for what collects logs; and back again, for people."""

from __future__ import annotations

import json
import logging
import sys
import threading
from datetime import UTC, datetime
from types import TracebackType
from typing import Final

log = logging.getLogger(__name__)

_FIELDS: Final = ("time", "level", "daemon", "message")


class JsonFormatter(logging.Formatter):
    """One JSON object a line: time (ISO 8601, UTC), level, daemon, message, and the stack of an
    exception if there is one.
    """

    def __init__(self, daemon: str) -> None:
        super().__init__()
        self._daemon = daemon

    def format(self, record: logging.LogRecord) -> str:
        """The record's line, without an end."""
        time = datetime.fromtimestamp(record.created, UTC)
        values = (
            time.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            record.levelname,
            self._daemon,
            record.getMessage(),
        )
        line = dict(zip(_FIELDS, values, strict=True))
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        elif record.exc_text:
            line["exception"] = record.exc_text
        # ASCII: a name from outside must not end the line for a reader that splits at U+2028.
        return json.dumps(line)


def in_json() -> bool:
    """Whether this process logs JSON."""
    return any(isinstance(h.formatter, JsonFormatter) for h in logging.getLogger().handlers)


def log_uncaught() -> None:
    """Log what no code catches, and Python's warnings, instead of writing them as plain text."""

    def in_thread(fault: threading.ExceptHookArgs) -> None:
        if fault.exc_type is not SystemExit and fault.exc_value is not None:
            name = "" if fault.thread is None else fault.thread.name
            log.critical("thread %s ended", name, exc_info=fault.exc_value)

    def at_the_end(
        kind: type[BaseException], error: BaseException, stack: TracebackType | None
    ) -> None:
        if issubclass(kind, KeyboardInterrupt):
            sys.__excepthook__(kind, error, stack)
        else:
            log.critical("ended by a fault", exc_info=(kind, error, stack))

    threading.excepthook = in_thread
    sys.excepthook = at_the_end
    logging.captureWarnings(True)


def complain(line: str) -> None:
    """Write a line for the user on standard error, as JSON where the log is."""
    if in_json():
        log.error("%s", line)
    else:
        print(line, file=sys.stderr)


def readable(line: str) -> list[str]:
    """A log line as text lines: one of `JsonFormatter` as the plain format has it, others as they
    are. The time is left out.
    """
    if not line.startswith('{"time": "'):
        return [line]
    try:
        found = json.loads(line)
        _, level, daemon, message = (str(found[name]) for name in _FIELDS)
    except (ValueError, KeyError, RecursionError):
        return [line]
    return [f"{daemon} {level} {message}", *str(found.get("exception", "")).splitlines()]
