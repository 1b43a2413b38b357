"""Drag reduction of a vehicle by its place in a platoon and by its gap.

Three laws: the paper's constants up to a gap of 7.5 m, and measurements of vans and of heavy
trucks, whose sources, conditions and conversion are in docs/vehicles.md. Between measured gaps a
reduction is linear, below the smallest one it stays what it is there, and beyond the largest it
falls linearly to 0 at twice that gap. Where a larger gap was measured to save more, by less than
the uncertainty, such neighbours are pooled, so that no reduction rises with the gap.

No numpy here: an agent may need it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Final, Literal, NamedTuple

from slipstream.energy.traction import ETA_FOLLOWER, ETA_LEADER
from slipstream.spacing import CLOSE_GAP_M

DragLaw = Literal["paper", "van", "truck"]


class DragReductions(NamedTuple):
    """η_drag by place, each in [0, 1).

    Attributes:
        leader: whatever the number of its followers.
        follower: of a platoon of two.
        middle: of three and more, with a vehicle in front and one behind.
        last: of three and more.
    """

    leader: float
    follower: float
    middle: float
    last: float

    def at(self, number: int, members: int) -> float:
        """η of one vehicle.

        Args:
            number: its place; 0 is the leader.
            members: of the platoon, itself included, at least two.
        """
        if number == 0:
            return self.leader
        if members == 2:
            return self.follower
        return self.last if number == members - 1 else self.middle


_NONE: Final = DragReductions(0.0, 0.0, 0.0, 0.0)
_PAPER: Final = DragReductions(ETA_LEADER, ETA_FOLLOWER, ETA_FOLLOWER, ETA_FOLLOWER)

_Points = Sequence[tuple[float, float]]
"""(gap, η), gaps in m, increasing."""

# Cerutti, Cafiero, Iuso 2021: front and rear at half a length, their mean at three lengths, which
# counts for the rear one alone. Zabat, Frascaroli, Browand 1994: no leader saves beyond a length.
_VAN_LENGTH_M: Final = 6.5
_VAN_FRONT: Final = ((0.5 * _VAN_LENGTH_M, 0.30), (_VAN_LENGTH_M, 0.0))
_VAN_REAR: Final = ((0.5 * _VAN_LENGTH_M, 0.43), (3.0 * _VAN_LENGTH_M, 0.20))

# Two trucks, tests of June 2019: fuel saved at each gap, and drag's share of the traction alone.
_TRUCK_GAPS_M: Final = (9.144, 12.192, 15.24, 22.86, 45.72, 78.6384)
_TRUCK_FRONT_FUEL: Final = (0.0624, 0.0502, 0.0355, 0.0225, 0.0048, 0.0124)
_TRUCK_REAR_FUEL: Final = (0.1036, 0.1177, 0.1159, 0.1066, 0.0710, 0.0574)
_TRUCK_DRAG_SHARE: Final = 0.641
# Four trucks at the same gaps, middle and last: Hussein, Rakha 2022, rational polynomials of drag.
# Their level exceeds what three trucks saved on a track, so only their ratio counts.
_TRUCK_MIDDLE_AND_LAST: Final = (
    (0.283, 0.255),
    (0.251, 0.265),
    (0.228, 0.264),
    (0.193, 0.244),
    (0.149, 0.202),
    (0.120, 0.167),
)


def reductions_at(law: DragLaw, gap_m: float) -> DragReductions:
    """η_drag of each place at a gap.

    Args:
        law: of the vehicle, whatever drives in front of it.
        gap_m: from bumper to bumper, ≥ 0: to the vehicle ahead, or behind the leader.
    """
    if law == "paper":
        return _PAPER if gap_m <= CLOSE_GAP_M else _NONE
    return DragReductions(*(_interpolated(points, gap_m) for points in _MEASURED[law]))


def greatest_reduction(law: DragLaw) -> float:
    """The largest η_drag of any place at any gap."""
    return max(reductions_at(law, 0.0))


def _interpolated(points: _Points, gap_m: float) -> float:
    """Piecewise linear; constant below the first gap, 0 from twice the last one on."""
    first, last = points[0], points[-1]
    if gap_m <= first[0]:
        return first[1]
    through = [*points, (2 * last[0], 0.0)]
    at = bisect_right(through, gap_m, key=lambda point: point[0])
    if at == len(through):
        return 0.0
    (gap0, eta0), (gap1, eta1) = through[at - 1 : at + 1]
    return eta0 + (eta1 - eta0) * (gap_m - gap0) / (gap1 - gap0)


def _pooled(values: Sequence[float]) -> list[float]:
    """The nearest values that never rise, by least squares: the mean of each rising run (pooling of
    adjacent violators; Barlow et al., Statistical Inference under Order Restrictions, 1972).
    """
    runs: list[tuple[float, int]] = []
    for value in values:
        runs.append((value, 1))
        while len(runs) > 1 and runs[-1][0] > runs[-2][0]:
            (mean0, count0), (mean1, count1) = runs[-2:]
            count = count0 + count1
            runs[-2:] = [((mean0 * count0 + mean1 * count1) / count, count)]
    return [mean for mean, count in runs for _ in range(count)]


def _truck_points() -> tuple[_Points, _Points, _Points, _Points]:
    """Of leader, follower, middle and last: the two behind the leader of three save together what
    two followers of platoons of two do.
    """
    front = [fuel / _TRUCK_DRAG_SHARE for fuel in _TRUCK_FRONT_FUEL]
    rear = _pooled([fuel / _TRUCK_DRAG_SHARE for fuel in _TRUCK_REAR_FUEL])
    both = list(zip(rear, _TRUCK_MIDDLE_AND_LAST, strict=True))
    middle = [2 * eta * m / (m + last) for eta, (m, last) in both]
    last = [2 * eta * last / (m + last) for eta, (m, last) in both]
    leader, follower, between, end = (
        tuple(zip(_TRUCK_GAPS_M, _pooled(etas), strict=True))
        for etas in (front, rear, middle, last)
    )
    return leader, follower, between, end


_MEASURED: Final[Mapping[DragLaw, tuple[_Points, _Points, _Points, _Points]]] = {
    "van": (_VAN_FRONT, _VAN_REAR, _VAN_REAR, _VAN_REAR),
    "truck": _truck_points(),
}
"""Points of leader, follower, middle and last."""
