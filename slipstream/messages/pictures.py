"""The time at which a picture on the bus was taken: in a comment segment of its JPEG.

A receiver that does not know of it skips it, as each JPEG decoder does.
"""

from __future__ import annotations

import re
from typing import Final

_HEAD: Final = re.compile(rb"\xff\xd8(?:\xff\xe0\x00\x10.{14})?", re.DOTALL)
"""The start, and JFIF's own segment, which has to be the first one."""
_COMMENT: Final = re.compile(rb"\xff\xfe..captured_ns=([0-9]{1,19})(?=\xff)", re.DOTALL)
_END_NS: Final = 2**63


def with_capture_time(jpeg: bytes, captured_ns: int) -> bytes:
    """A JPEG that says when it was taken, UTC, ns."""
    head = _HEAD.match(jpeg)
    assert head is not None
    text = b"captured_ns=%d" % captured_ns
    comment = b"\xff\xfe" + (len(text) + 2).to_bytes(2, "big") + text
    return jpeg[: head.end()] + comment + jpeg[head.end() :]


def capture_time_ns(jpeg: bytes) -> int | None:
    """UTC, ns, at which a picture was taken; None where its sender does not say."""
    head = _HEAD.match(jpeg)
    comment = None if head is None else _COMMENT.match(jpeg, head.end())
    time_ns = None if comment is None else int(comment[1])
    return time_ns if time_ns is not None and time_ns < _END_NS else None
