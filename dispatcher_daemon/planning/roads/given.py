"""Matrices that a request or a file gives instead of roads, and where no way leads in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from dispatcher_daemon.planning.roads.weights import Floats

NO_WAY_ENTRY: Final = 2**31 - 1
"""Routing engines answer this, or 2³² − 1, where no way leads: 68 years, or 53 times round the
Earth. Others answer null."""

Rows = Sequence[Sequence[float | None]]


def given_matrices(*given: Rows | None) -> list[Floats | None]:
    """Matrices of one kind of vehicle as arrays: inf in all of them where one has no way, that is
    None or at least `NO_WAY_ENTRY`. Staying at a place needs no way: such an entry is 0.
    """
    found = [None if rows is None else np.array(rows, dtype=np.float64) for rows in given]
    known = [values for values in found if values is not None]
    for values in known:
        values[~(values < NO_WAY_ENTRY)] = np.inf
        diagonal = np.einsum("ii->i", values)
        diagonal[np.isinf(diagonal)] = 0.0
    if known:
        blocked = np.any([np.isinf(values) for values in known], axis=0)
        for values in known:
            values[blocked] = np.inf
    return found
