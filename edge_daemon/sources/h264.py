"""The frame rate that a raw H.264 stream states in its header (ITU-T H.264, 7.3.2.1 and E.1)."""

from __future__ import annotations

import re
from typing import Final

from edge_daemon.settings import MAX_FPS

_SEQUENCE_SET: Final = re.compile(
    rb"\x00\x00\x01[\x07\x27\x47\x67](.{4,400}?)(?:\x00\x00[\x00\x01]|\Z)", re.DOTALL
)
_STREAM: Final = re.compile(rb"\x00{2,3}\x01[\x06\x07\x09\x26\x27\x46\x47\x66\x67]")
_HIGH_PROFILES: Final = frozenset({44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244})
_ANY_SHAPE: Final = 255


def h264_rate(head: bytes) -> float | None:
    """Frames a second by the beginning of a file; None where it is no such stream, or does not
    state a plausible rate.
    """
    found = _SEQUENCE_SET.search(head) if _STREAM.match(head) else None
    if found is None:
        return None
    bits = _Bits(found[1].replace(b"\x00\x00\x03", b"\x00\x00"))
    try:
        ticks, scale = _timing(bits)
    except IndexError:  # cut off
        return None
    # Two ticks a frame: one for each field.
    fps = scale / (2 * ticks) if ticks else 0.0
    return fps if 1.0 <= fps <= MAX_FPS else None


class _Bits:
    """Reads a payload bit by bit; IndexError at its end."""

    def __init__(self, payload: bytes) -> None:
        self._payload = payload
        self._at = 0

    def take(self, count: int) -> int:
        """An unsigned number of so many bits."""
        value = 0
        for _ in range(count):
            value = value << 1 | self._payload[self._at // 8] >> (7 - self._at % 8) & 1
            self._at += 1
        return value

    def golomb(self) -> int:
        """An unsigned Exp-Golomb code."""
        zeros = 0
        while not self.take(1):
            zeros += 1
        return (1 << zeros) - 1 + self.take(zeros)

    def signed_golomb(self) -> int:
        """A signed Exp-Golomb code."""
        code = self.golomb()
        return (code + 1) // 2 if code % 2 else -(code // 2)


def _timing(bits: _Bits) -> tuple[int, int]:
    """(units in a tick, ticks a second) of a sequence parameter set; zeros where it has none."""
    profile = bits.take(8)
    bits.take(16)
    bits.golomb()
    if profile in _HIGH_PROFILES:
        _skip_high_profile(bits)
    bits.golomb()
    _skip_picture_order(bits)
    bits.golomb()
    bits.take(1)
    bits.golomb()
    bits.golomb()
    if not bits.take(1):  # fields, not frames alone
        bits.take(1)
    bits.take(1)
    if bits.take(1):
        for _ in range(4):  # cropping
            bits.golomb()
    if not bits.take(1):  # no further information
        return 0, 0
    if bits.take(1) and bits.take(8) == _ANY_SHAPE:
        bits.take(32)
    if bits.take(1):
        bits.take(1)
    if bits.take(1):
        bits.take(4)
        if bits.take(1):
            bits.take(24)
    if bits.take(1):
        bits.golomb()
        bits.golomb()
    return (bits.take(32), bits.take(32)) if bits.take(1) else (0, 0)


def _skip_high_profile(bits: _Bits) -> None:
    chroma = bits.golomb()
    if chroma == 3:
        bits.take(1)
    bits.golomb()
    bits.golomb()
    bits.take(1)
    if bits.take(1):
        for index in range(12 if chroma == 3 else 8):
            if bits.take(1):
                _skip_scaling_list(bits, 16 if index < 6 else 64)


def _skip_scaling_list(bits: _Bits, size: int) -> None:
    last = following = 8
    for _ in range(size):
        if following:
            following = (last + bits.signed_golomb()) % 256
        last = following or last


def _skip_picture_order(bits: _Bits) -> None:
    kind = bits.golomb()
    if kind == 0:
        bits.golomb()
    elif kind == 1:
        bits.take(1)
        bits.golomb()
        bits.golomb()
        for _ in range(bits.golomb()):
            bits.golomb()
