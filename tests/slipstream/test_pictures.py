"""The capture time in a picture's JPEG."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from slipstream.messages import capture_time_ns, with_capture_time

_TAKEN_NS = 1_700_000_000_123_456_789


def a_jpeg() -> bytes:
    """A picture without a capture time."""
    return cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()


def test_a_picture_tells_when_it_was_taken() -> None:
    """The time is read back to the nanosecond, and the picture decodes as without it."""
    jpeg = a_jpeg()
    stamped = with_capture_time(jpeg, _TAKEN_NS)
    assert capture_time_ns(stamped) == _TAKEN_NS
    decoded = [cv2.imdecode(np.frombuffer(data, np.uint8), 1) for data in (jpeg, stamped)]
    assert np.array_equal(*decoded)


@pytest.mark.parametrize(
    "jpeg",
    [
        b"",
        b"no picture",
        a_jpeg(),
        b"\xff\xd8\xff\xfe\x00\x10captured_ns=12",
        b"\xff\xd8\xff\xfe\x00\x10captured_ns=9999999999999999999\xff\xd9",
        b"\xff\xd8\xff\xfe\x00\x10captured_ns=-5\xff\xd9",
    ],
)
def test_a_picture_without_a_usable_time_has_none(jpeg: bytes) -> None:
    """What a sender does not say, or says wrongly, is not made up."""
    assert capture_time_ns(jpeg) is None
