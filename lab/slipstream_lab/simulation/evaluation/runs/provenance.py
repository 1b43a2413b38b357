"""Provenance of an evaluation: digests of its inputs and of the simulating code."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from typing import Final

from slipstream.braking import Road
from slipstream.sources import sources_digest
from slipstream.vehicle_types import PRESETS, PresetName, VehicleType
from slipstream_lab.simulation.closed_loop.policy import AS_DRIVING, WaitingPrices
from slipstream_lab.simulation.rsus import Rsu
from slipstream_lab.simulation.scenarios.perception import measured_errors
from slipstream_lab.simulation.scenarios.scenario import Scenario, SignalControl

FORMAT: Final = 7
"""Of stored arms. Raise it when the same order gives another result, or means another thing."""

_PACKAGES: Final = (
    *("slipstream", "edge_daemon", "vehicle_agent", "dispatcher_daemon"),
    "slipstream_lab.simulation",
)
_EXCLUDED: Final = frozenset(
    f"slipstream_lab.simulation/{part}"
    for part in ("evaluation", "training", "streetdrive", "sumo_view", "live")
)
"""Packages that only render, display or report."""


@dataclass(frozen=True)
class Provenance:
    """Inputs that all arms of a folder share; results depend on every one.

    Attributes:
        demand: of the settings of the background; of its route files where these are the user's,
            and of the user's additional files.
        rsus: of the RSUs; empty where they are found by the traffic.
        waiting_kw: price of waiting at the depot; None: that of driving time, as in arms that were
            stored before it could be given.
        type: of the fleet's vehicles; None: the paper's car, likewise.
    """

    scenario: str
    net: str
    demand: str
    rsus: str
    fleet: str
    perception: str
    signals: SignalControl
    begin_s: float
    end_s: float
    step_s: float
    format: int = FORMAT
    waiting_kw: float | None = None
    standing_kw: float | None = None
    road: Road = "dry"
    type: PresetName | None = None

    @property
    def vehicle_type(self) -> VehicleType:
        """Of the fleet's vehicles."""
        return PRESETS[self.type or "paper_car"]


def provenance_of(
    scenario: Scenario,
    signals: SignalControl,
    span_s: tuple[float, float],
    step_s: float,
    prices: WaitingPrices = AS_DRIVING,
    road: Road = "dry",
) -> Provenance:
    """The provenance of a scenario's arms."""
    rsus = scenario.rsus
    background = [path.read_bytes() for path in scenario.routes]
    background = background or [scenario.demand.digest_text().encode()]
    return Provenance(
        scenario.name,
        _digest(scenario.net.read_bytes()),
        _digest(_together([*background, *(path.read_bytes() for path in scenario.additional)])),
        "" if rsus is None else _digest(json.dumps([_rsu_data(rsu) for rsu in rsus]).encode()),
        _digest(scenario.fleet.digest_text().encode()),
        _digest(measured_errors().model_dump_json().encode()),
        signals,
        *span_s,
        step_s,
        waiting_kw=prices.waiting_kw,
        standing_kw=prices.standing_kw,
        road=road,
        type=None if scenario.fleet.type == "paper_car" else scenario.fleet.type,
    )


def code_stamp() -> str:
    """Versions, and a digest of the sources that an arm's result can depend on."""
    return (
        f"slipstream {_version('slipstream')}, libsumo {_version('libsumo')}, "
        f"sources {sources_digest(_PACKAGES, _EXCLUDED)[:12]}"
    )


def _rsu_data(rsu: Rsu) -> dict[str, object]:
    """An RSU's settings without defaults, so that a new setting changes no older digest.

    A changed default needs a higher FORMAT.
    """
    return rsu.model_dump(mode="json", exclude_defaults=True)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "?"


def _together(parts: Sequence[bytes]) -> bytes:
    """One part as it is; several by their digests, so that no two sets are alike."""
    return parts[0] if len(parts) == 1 else "".join(map(_digest, parts)).encode()


def _digest(data: bytes) -> str:
    return sha256(data).hexdigest()
