"""Questions that have arrived on a key expression, and their answers."""

from __future__ import annotations

import json
import logging
import queue
import threading
from collections.abc import Callable
from typing import Any, Final

import zenoh

from slipstream.messages import ENCODING, check_version
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

Answerer = Callable[[str, bytes], tuple[bool, bytes]]
"""(key, payload) → (whether it is an answer, or else an error; payload)."""

_OURS: Final = zenoh.Encoding(ENCODING)

MAX_WAITING: Final = 256
MAX_QUESTION_BYTES: Final = 2**20
_BUSY: Final = b'{"problem":"too many questions wait","mend":"ask again later"}'
_OVERSIZED: Final = b'{"problem":"the question is larger than 1 MiB","mend":"send less at once"}'
_PATTERN: Final = b'{"problem":"a pattern of keys","mend":"ask for one key"}'


class Answers:
    """Questions between zenoh's thread, which must not block, and the answerer's own.

    Args:
        answerer: called for one question after the other; what it raises is logged, and the one who
            asked gets no answer.
    """

    def __init__(self, name: str, answerer: Answerer) -> None:
        self._answerer = answerer
        self._waiting: queue.Queue[tuple[Any, str, bytes] | None] = queue.Queue(MAX_WAITING + 1)
        self._closed = False
        self._limiter = LogLimiter()
        self._thread = threading.Thread(target=self._run, name=f"answers {name}", daemon=True)
        self._thread.start()

    def accept(self, query: Any) -> None:
        """Take in a zenoh query; returns at once."""
        key, payload = str(query.key_expr), query.payload
        if "*" in key:
            # Access is given by key: nobody may do by a pattern what it may not do by a key.
            query.reply_err(_PATTERN)
        elif payload is not None and len(payload) > MAX_QUESTION_BYTES:
            query.reply_err(_OVERSIZED)
        elif self._closed or self._waiting.qsize() >= MAX_WAITING:
            query.reply_err(_BUSY)
        else:
            try:
                check_version(str(query.encoding))
            except ValueError as error:
                refusal = {"problem": str(error), "mend": "ask in the version that is read"}
                query.reply_err(json.dumps(refusal).encode())
            else:
                self._waiting.put((query, key, b"" if payload is None else payload.to_bytes()))

    def close(self) -> None:
        """Let go of what waits; the answerer does not run once it has returned."""
        self._closed = True
        self._waiting.put(None)
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            item = self._waiting.get()
            if item is None or self._closed:
                return
            query, key, payload = item
            try:
                is_answer, text = self._answerer(key, payload)
                if is_answer:
                    query.reply(key, text, encoding=_OURS)
                else:
                    query.reply_err(text, encoding=_OURS)
            except Exception:
                if self._limiter.allow(""):
                    log.exception("a question on %s has no answer", key)
            # zenoh ends a question when its last reference is gone.
            del item, query
