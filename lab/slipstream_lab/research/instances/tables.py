"""Roads and traffic of an instance file, to and from what the dispatcher works with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

from dispatcher_daemon.traffic import SegmentTraffic, TrafficSnapshot
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork, Segment, build_network
from slipstream.roads.access import Access
from slipstream.roads.sumo_net import DEMO_NETWORK, load_network
from slipstream_lab.research.instances.schema import (
    AccessTable,
    JunctionRow,
    NetworkTable,
    SegmentRow,
    TrafficRow,
    TrafficTable,
    TurnClassesRow,
    TurnRow,
)

Turns = Mapping[str, tuple[str, ...]]


def first_twice(names: Iterable[str]) -> str | None:
    """The first name that comes twice; None if all differ."""
    return next((name for name, count in Counter(names).items() if count > 1), None)


def network_of(table: NetworkTable, name: str, source: str | Path) -> RoadNetwork:
    """The roads of an instance.

    Args:
        name: the network's, where the table has none.
        source: the instance's file: errors name it, and the path of a SUMO net starts there.

    Raises:
        InputError: an id twice, something unknown, or a SUMO net that cannot be read.
    """
    if table.sumo_net is not None:
        if table.sumo_net == DEMO_NETWORK:
            return load_network(DEMO_NETWORK)
        return load_network(Path(source).parent / table.sumo_net)
    for what, ids in (
        ("junctions", [row.id for row in table.junctions]),
        ("turns", [row.segment for row in table.turns]),
    ):
        repeated = first_twice(ids)
        if repeated is not None:
            key = f"network.{what}.{repeated}"
            raise InputError(source, f"two {what} with this id", "remove one", key=key)
    places = {row.id: (row.x_m, row.y_m) for row in table.junctions}
    segments = [
        Segment(
            row.id,
            row.start,
            row.end,
            row.length_m,
            row.speed_limit_mps,
            row.lanes,
            row.shape or (places.get(row.start, (0.0, 0.0)), places.get(row.end, (0.0, 0.0))),
            _access_of(row.access),
        )
        for row in table.segments
    ]
    known = {row.id for row in table.segments}
    for turn in table.turn_classes:
        for name_of in (turn.segment, turn.onto):
            if name_of not in known:
                key, problem = f"network.turn_classes.{turn.segment}", f"no segment {name_of!r}"
                raise InputError(source, problem, "name one of the segments", key=key)
    given: Turns = {row.segment: row.onto for row in table.turns}

    def build(turns: Turns | None) -> RoadNetwork:
        return build_network(
            table.name or name,
            segments,
            places,
            turns,
            signals=[row.id for row in table.junctions if row.signal],
            turn_classes={
                (row.segment, row.onto): frozenset(row.classes) for row in table.turn_classes
            },
            source=str(source),
            prefix="network.segments.",
        )

    free = build(None)
    return build({**free.follows, **given}) if given else free


def network_table(network: RoadNetwork) -> NetworkTable:
    """The roads written out; `network_of` reverses it. What only agents need is left out: the ways
    through junctions, and the projection.
    """
    straight = build_network("", network.segments.values(), network.junctions).follows
    return NetworkTable(
        name=network.name,
        junctions=tuple(
            JunctionRow(id=name, x_m=x, y_m=y, signal=name in network.signals)
            for name, (x, y) in network.junctions.items()
        ),
        segments=tuple(
            SegmentRow(
                id=segment.id,
                start=segment.start,
                end=segment.end,
                length_m=segment.length_m,
                speed_limit_mps=segment.speed_limit_mps,
                lanes=segment.lanes,
                shape=None
                if segment.shape
                == (network.junctions[segment.start], network.junctions[segment.end])
                else segment.shape,
                access=_access_table(segment.access),
            )
            for segment in network.segments.values()
        ),
        turns=tuple(
            TurnRow(segment=name, onto=onto)
            for name, onto in network.follows.items()
            if onto != straight[name]
        ),
        turn_classes=tuple(
            TurnClassesRow.model_validate(
                {"segment": segment, "onto": onto, "classes": sorted(classes)}
            )
            for (segment, onto), classes in network.turn_classes.items()
        ),
    )


def _access_of(table: AccessTable) -> Access:
    values = dict(table)
    if table.classes is not None:
        values["classes"] = frozenset(table.classes)
    return Access(**values)


def _access_table(access: Access) -> AccessTable:
    values = {**vars(access)}
    if access.classes is not None:
        values["classes"] = sorted(access.classes)
    return AccessTable.model_validate(values)


def snapshot_of(table: TrafficTable, network: RoadNetwork, source: str | Path) -> TrafficSnapshot:
    """The traffic of an instance on all segments of its network. Raises InputError: a segment
    twice or unknown, or a speed above its limit.
    """
    repeated = first_twice(row.segment for row in table.segments)
    if repeated is not None:
        key = f"traffic.segments.{repeated}"
        raise InputError(source, "two rows for this segment", "remove one", key=key)
    rows = {row.segment: row for row in table.segments}
    for name, row in rows.items():
        segment, key = network.segments.get(name), f"traffic.segments.{name}"
        if segment is None:
            mend = f"use a segment of network {network.name!r}"
            raise InputError(source, "unknown segment", mend, key=key)
        limit = segment.speed_limit_mps
        if row.speed_mps is not None and row.speed_mps > limit:
            problem = f"{row.speed_mps:g} is above the speed limit of {limit:g}"
            raise InputError(source, problem, "lower it", key=f"{key}.speed_mps")
    traffic = {}
    for name, segment in network.segments.items():
        row = rows.get(name) or TrafficRow(segment=name)
        stops = row.stops
        if stops is None:
            stops = table.stops_at_signals if segment.end in network.signals else 0.0
        reason = row.reason or {0: "turbulent", 1: None, None: "unwatched"}[row.y_e]
        traffic[name] = SegmentTraffic(
            segment=name,
            speed_mps=segment.speed_limit_mps if row.speed_mps is None else row.speed_mps,
            y_e=row.y_e,
            open=reason is None,
            reason=reason,
            age_s=row.age_s,
            measured_speed_mps=row.measured_speed_mps,
            mean_acceleration_mps2=row.mean_acceleration_mps2,
            acceleration_variance_m2ps4=row.acceleration_variance_m2ps4,
            stops=stops,
        )
    return TrafficSnapshot(table.now_ns, MappingProxyType(traffic), ())


def traffic_table(snapshot: TrafficSnapshot, network: RoadNetwork) -> TrafficTable:
    """The traffic without its RSUs' states; `snapshot_of` reverses it. Raises ValueError: a gate
    is open without y_e = 1, or closed without a reason.
    """
    rows = []
    for name, traffic in snapshot.segments.items():
        if traffic.open != (traffic.reason is None) or (traffic.open and traffic.y_e != 1):
            raise ValueError(f"a gate that is open without y_e = 1, or closed without why: {name}")
        limit = network.segments[name].speed_limit_mps
        row = TrafficRow(
            segment=name,
            speed_mps=None if traffic.speed_mps == limit else traffic.speed_mps,
            y_e=traffic.y_e,
            reason=traffic.reason,
            age_s=traffic.age_s,
            measured_speed_mps=traffic.measured_speed_mps,
            mean_acceleration_mps2=traffic.mean_acceleration_mps2,
            acceleration_variance_m2ps4=traffic.acceleration_variance_m2ps4,
            stops=traffic.stops or None,
        )
        if row != TrafficRow(segment=name, reason="unwatched"):
            rows.append(row)
    return TrafficTable(now_ns=snapshot.now_ns, segments=tuple(rows))
