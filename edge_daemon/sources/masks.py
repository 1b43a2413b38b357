"""What must not be looked at is grey before anything looks at a frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from edge_daemon.camera import Array, hide
from edge_daemon.frame import Frame


def hidden(frames: Iterable[Frame | None], masks: Sequence[Array]) -> Iterator[Frame | None]:
    """The same frames, grey within outlines, px, each (n, 2)."""
    for frame in frames:
        if frame is not None:
            hide(frame.image, masks)
        yield frame
