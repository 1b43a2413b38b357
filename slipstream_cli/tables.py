"""Tables of reports in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def markdown_table(
    columns: Sequence[str], rows: Iterable[Sequence[object]], *, left: Iterable[int] = (0,)
) -> str:
    """A Markdown table without a final line break.

    Args:
        left: indices of left-aligned columns; the others are right-aligned.
    """
    aligned_left = frozenset(left)
    marks = ("---" if column in aligned_left else "--:" for column in range(len(columns)))
    return "\n".join(_line(cells) for cells in (columns, tuple(marks), *rows))


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"
