"""What a simulated day leaves: traffic by segment and interval, trips by hour, RSU windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

import numpy as np

from slipstream_lab.simulation.scenarios.demand import Array, Indices

if TYPE_CHECKING:
    from slipstream_lab.simulation.scenarios.perception import Observation

HOUR_S: Final = 3600.0


@dataclass(frozen=True)
class Traffic:
    """Traffic on segments in intervals of equal length; arrays of shape (intervals, segments)."""

    begin_s: float
    interval_s: float
    segments: tuple[str, ...]
    present_s: Array
    distance_m: Array
    waiting_s: Array
    entered: Array

    def speed_mps(self) -> Array:
        """Mean speed over time and vehicles; NaN where no vehicle was."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(
                np.where(self.present_s > 0, self.distance_m / self.present_s, np.nan)
            )

    def vehicles(self) -> Array:
        """Mean number of vehicles on the segment; over its length, the density."""
        return self.present_s / self.interval_s


@dataclass(frozen=True)
class Hour:
    """One hour of the day: of the network, of the trips that departed in it and arrived, and of the
    RSUs' windows that ended in it.

    Attributes:
        speed_mps: vehicle-kilometres over vehicle-hours; NaN in an empty hour.
    """

    speed_mps: float
    running: float
    waiting_share: float
    arrived: int
    stops_per_km: float
    time_loss_share: float
    judged: int
    stable: int

    @property
    def stable_share(self) -> float:
        """Of the judged windows; NaN where there are none."""
        return self.stable / self.judged if self.judged else float("nan")


@dataclass(frozen=True)
class Statistics:
    """SUMO's counts of the whole run; delays and safety are those of its statistic output."""

    loaded: int
    inserted: int
    running: int
    waiting: int
    teleports: int
    collisions: int
    emergency_stops: int
    emergency_brakings: int
    mean_depart_delay_s: float
    most_depart_delay_s: float


@dataclass(frozen=True)
class SimulatedDay:
    """A simulated day, or a part of one.

    Attributes:
        end_s: simulated; earlier than asked for after a gridlock.
        statistics: SUMO's.
        gridlock_s: when most vehicles had stood for long; None: never.
    """

    begin_s: float
    end_s: float
    statistics: Statistics
    traffic: Traffic
    hours: tuple[Hour, ...]
    observations: tuple[Observation, ...]
    gridlock_s: float | None
    wall_s: float


def read_statistics(path: Path, trips: Sequence[TripInfo]) -> Statistics:
    """Read SUMO's statistic output."""
    root = ElementTree.parse(path).getroot()

    def number(element: str, name: str) -> int:
        found = root.find(element)
        return 0 if found is None else round(float(found.get(name, 0.0)))

    found = root.find("vehicleTripStatistics")
    mean = 0.0 if found is None else float(found.get("departDelay", 0.0))
    return Statistics(
        loaded=number("vehicles", "loaded"),
        inserted=number("vehicles", "inserted"),
        running=number("vehicles", "running"),
        waiting=number("vehicles", "waiting"),
        teleports=number("teleports", "total"),
        collisions=number("safety", "collisions"),
        emergency_stops=number("safety", "emergencyStops"),
        emergency_brakings=number("safety", "emergencyBraking"),
        mean_depart_delay_s=mean,
        most_depart_delay_s=max((trip.delay_s for trip in trips), default=0.0),
    )


def read_traffic(
    path: Path, segments: tuple[str, ...], begin_s: float, end_s: float, interval_s: float
) -> Traffic:
    """Read SUMO's edge data, written every `interval_s`."""
    index = {name: i for i, name in enumerate(segments)}
    count = max(1, int(np.ceil((end_s - begin_s) / interval_s)))
    table = np.zeros((4, count, len(segments)))
    row = -1
    for event, element in ElementTree.iterparse(path, events=("start", "end")):
        if element.tag == "interval":
            if event == "start":
                row = int((float(element.get("begin", 0.0)) - begin_s) // interval_s)
            else:
                element.clear()
        elif element.tag == "edge" and event == "end" and 0 <= row < count:
            column = index.get(element.get("id", ""))
            present = float(element.get("sampledSeconds", 0.0))
            if column is not None:
                table[:, row, column] = (
                    present,
                    present * float(element.get("speed", 0.0)),
                    float(element.get("waitingTime", 0.0)),
                    float(element.get("entered", 0.0)) + float(element.get("departed", 0.0)),
                )
    return Traffic(begin_s, interval_s, segments, *table)


@dataclass(frozen=True)
class TripInfo:
    """SUMO's record of a trip that ended; times in s since midnight."""

    id: str
    depart_s: float
    delay_s: float
    duration_s: float
    distance_m: float
    time_loss_s: float
    stops: int


def read_trips(path: Path) -> list[TripInfo]:
    """Read SUMO's trip output."""
    trips = []
    for _, element in ElementTree.iterparse(path, events=("end",)):
        if element.tag == "tripinfo":
            value = element.attrib
            trips.append(
                TripInfo(
                    value["id"],
                    float(value["depart"]),
                    float(value["departDelay"]),
                    float(value["duration"]),
                    float(value["routeLength"]),
                    float(value["timeLoss"]),
                    int(value["waitingCount"]),
                )
            )
            element.clear()
    return trips


def hours_of(
    traffic: Traffic,
    trips: Sequence[TripInfo],
    end_s: float,
    observations: Sequence[Observation],
    min_vehicles: int,
) -> tuple[Hour, ...]:
    """Sum up by hours of the clock; an interval counts for the hour that it begins in."""
    truths = [
        (o.time_s, o.truth.y_e)
        for o in observations
        if o.truth is not None and o.truth.vehicles >= min_vehicles
    ]
    first, last = int(traffic.begin_s // HOUR_S), int(np.ceil(end_s / HOUR_S))
    starts = traffic.begin_s + traffic.interval_s * np.arange(len(traffic.present_s))
    hour_of_row: Indices = (starts // HOUR_S).astype(np.int64)
    hours = []
    for hour in range(first, last):
        rows = hour_of_row == hour
        present, driven, stood = (
            float(table[rows].sum())
            for table in (traffic.present_s, traffic.distance_m, traffic.waiting_s)
        )
        seconds = float(rows.sum()) * traffic.interval_s
        own = [trip for trip in trips if trip.depart_s // HOUR_S == hour]
        flags = [y_e for time_s, y_e in truths if -(-time_s // HOUR_S) - 1 == hour]
        distance = sum(trip.distance_m for trip in own)
        duration = sum(trip.duration_s for trip in own)
        hours.append(
            Hour(
                speed_mps=driven / present if present else float("nan"),
                running=present / seconds if seconds else 0.0,
                waiting_share=stood / present if present else 0.0,
                arrived=len(own),
                stops_per_km=1000 * sum(trip.stops for trip in own) / distance if distance else 0.0,
                time_loss_share=sum(trip.time_loss_s for trip in own) / duration
                if duration
                else 0.0,
                judged=len(flags),
                stable=sum(y_e == 1 for y_e in flags),
            )
        )
    return tuple(hours)
