"""What a site measures now, and why where it measures nothing that counts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

from dispatcher_daemon.service.feeds.sites import Site
from slipstream import freshness
from slipstream.messages import (
    CAMERA_FAULTS,
    Estimate,
    KinematicFeatures,
    SegmentCounts,
    SegmentState,
)
from slipstream.roads import RoadNetwork
from slipstream.roads.admission import implausibility

NO_STATE: Final = "no_state"
"""Why a site measures nothing whose RSU has told nothing of it yet."""
INTERMITTENT: Final = frozenset({"low_frame_rate", "window_not_covered"})
"""Reasons with which a window was not seen as a whole."""
SPURIOUS: Final = frozenset({"implausible", "opposite_direction"})
"""Reasons with which what was measured is contradicted by physics or by the road."""
_UNRELIABLE: Final = frozenset({*CAMERA_FAULTS, *INTERMITTENT, *SPURIOUS, "no_frames"})


@dataclass(frozen=True)
class Measurement:
    """A site's latest window.

    Attributes:
        state: its latest state, however old; None: there is none, or its time cannot be true.
        y_e: 1 stable, 0 turbulent, None unknown.
        reason: why y_e is unknown: the state's reason, "stale", "future" or "no_state".
        features: what was measured; None where nothing was, or nothing that can be relied on.
        counts: of the last complete quarter hour; None: there are none that are fresh and have a
            flow.
    """

    site: Site
    state: SegmentState | None
    y_e: Literal[0, 1] | None
    reason: str | None
    features: KinematicFeatures | None
    counts: SegmentCounts | None = None

    @property
    def missing(self) -> str:
        """Why there are no features, where there are none."""
        return self.reason or "no_vehicle"

    @property
    def is_current(self) -> bool:
        """Whether the state is fresh, whatever it says."""
        return self.state is not None and self.reason != "stale"


def measurements(
    sites: Iterable[Site],
    states: Iterable[SegmentState],
    network: RoadNetwork,
    now_ns: int,
    *,
    stale_after_s: float = freshness.STALE_AFTER_S,
    counts: Iterable[SegmentCounts] = (),
) -> tuple[Measurement, ...]:
    """What each site measures, in the sites' order.

    States that are physically impossible, as the dispatcher refuses them, count as none.

    Args:
        states: the latest of each RSU and segment; those of other sites are left out.
        counts: complete ones; of each RSU and segment the latest that is fresh is taken.
    """
    latest: Mapping[tuple[str, str], SegmentState] = {
        (state.rsu, state.segment): state
        for state in states
        if state.segment in network.segments
        and implausibility(state, network.segments[state.segment]) is None
    }

    counted: dict[tuple[str, str], SegmentCounts] = {}
    for one in sorted(counts, key=lambda one: one.began_ns):
        is_fresh = freshness.age_s(one.until_ns, now_ns) <= freshness.COUNTS_FRESH_S
        is_fresh &= not freshness.is_ahead(one.until_ns, now_ns)
        if is_fresh and one.flow_vph(one.vehicles) is not None:
            counted[one.rsu, one.segment] = one

    def of(site: Site) -> Measurement:
        return replace(window(site), counts=counted.get((site.rsu, site.segment)))

    def window(site: Site) -> Measurement:
        state = latest.get((site.rsu, site.segment))
        if state is None:
            return Measurement(site, None, None, NO_STATE, None)
        fault = freshness.fault(state.time_ns, now_ns, stale_after_s=stale_after_s)
        if fault is not None:
            return Measurement(site, None if fault == "future" else state, None, fault, None)
        features = None if state.reason in _UNRELIABLE else state.features
        return Measurement(site, state, state.y_e, state.reason, features)

    return tuple(of(site) for site in sites)


def flow_vph(features: KinematicFeatures) -> Estimate:
    """Vehicles an hour, ≥ 0.

    Density is the time that vehicles spent on the segment by its length and the window, and the
    mean speed is weighted by that time, so that their product is the flow (Edie, 1963). The two
    errors are taken as independent.
    """
    speed, density = features.mean_speed_mps, features.density_veh_per_m
    mean = max(0.0, speed.value)
    errors = density.standard_error, speed.standard_error
    error = (
        None
        if errors[0] is None or errors[1] is None
        else 3600.0 * math.hypot(mean * errors[0], density.value * errors[1])
    )
    return Estimate(value=3600.0 * mean * density.value, standard_error=error)


def speed_cv(features: KinematicFeatures) -> Estimate | None:
    """Coefficient of variation of the speed, by which y_e is judged; None where traffic stands."""
    mean, spread = features.mean_speed_mps, features.speed_std_mps
    if mean.value <= 0:
        return None
    value = spread.value / mean.value
    error = (
        None
        if spread.standard_error is None or mean.standard_error is None
        else math.hypot(spread.standard_error, value * mean.standard_error) / mean.value
    )
    if not all(math.isfinite(part) for part in (value, error or 0.0)):
        return None
    return Estimate(value=value, standard_error=error)
