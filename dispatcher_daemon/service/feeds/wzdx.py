"""WZDx v4.2 DeviceFeed (US DOT): each site as a traffic sensor."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from dispatcher_daemon.service.feeds.measurements import Measurement, flow_vph
from dispatcher_daemon.service.feeds.sites import iso_time, window
from dispatcher_daemon.settings import FeedSettings
from slipstream import freshness
from slipstream.messages import CAMERA_FAULTS, RsuHealth

_VERSION: Final = "4.2"
_KMH: Final = 3.6


def device_feed(
    measured: Sequence[Measurement],
    healths: Mapping[str, RsuHealth],
    settings: FeedSettings,
    now_ns: int,
    *,
    stale_after_s: float = freshness.STALE_AFTER_S,
) -> bytes:
    """The DeviceFeed of what sites measure, as UTF-8 GeoJSON."""
    fresh = {
        rsu: health
        for rsu, health in healths.items()
        if freshness.fault(health.time_ns, now_ns, stale_after_s=stale_after_s) is None
    }
    feed = {
        "feed_info": {
            "publisher": settings.publisher,
            "version": _VERSION,
            "update_date": iso_time(now_ns),
            "data_sources": [
                {
                    "data_source_id": settings.publisher,
                    "organization_name": settings.publisher,
                    "update_date": iso_time(now_ns),
                }
            ],
        },
        "type": "FeatureCollection",
        "features": [
            _feature(each, fresh.get(each.site.rsu), settings.publisher, now_ns)
            for each in measured
        ],
    }
    return json.dumps(feed, ensure_ascii=False, allow_nan=False).encode()


def _feature(
    measured: Measurement, health: RsuHealth | None, source: str, now_ns: int
) -> dict[str, Any]:
    site = measured.site
    # GeoJSON has the longitude first.
    latitude, longitude = (float(degrees) for degrees in site.middle)
    return {
        "id": site.id,
        "type": "Feature",
        "properties": _sensor(measured, health, source, now_ns),
        "geometry": {"type": "Point", "coordinates": [longitude, latitude]},
    }


def _sensor(
    measured: Measurement, health: RsuHealth | None, source: str, now_ns: int
) -> dict[str, Any]:
    state, features = measured.state, measured.features
    status, messages = device_status(measured, health)
    # Where nothing was collected the interval is empty: it is a required property.
    begin, end = (iso_time(now_ns),) * 2 if state is None else window(state.time_ns, state.window_s)
    told_ns = [message.time_ns for message in (state, health) if message is not None]
    core: dict[str, Any] = {
        "device_type": "traffic-sensor",
        "data_source_id": source,
        "device_status": status,
        "update_date": iso_time(min(now_ns, max(told_ns, default=now_ns))),
        "has_automatic_location": False,
        "name": measured.site.name,
    }
    if messages:
        core["status_messages"] = messages
    sensor: dict[str, Any] = {
        "core_details": core,
        "collection_interval_start_date": begin,
        "collection_interval_end_date": end,
    }
    if features is not None:
        sensor["average_speed_kph"] = round(_KMH * max(0.0, features.mean_speed_mps.value), 3)
        sensor["volume_vph"] = round(flow_vph(features).value, 1)
    return sensor


def device_status(measured: Measurement, health: RsuHealth | None) -> tuple[str, list[str]]:
    """Status of a device and its messages.

    Without a fresh health its fresh state tells: one with a flag comes from a device that works.

    Args:
        health: its RSU's fresh health; None: there is none.
    """
    messages = [] if measured.reason is None else [f"stability unknown: {measured.reason}"]
    if health is not None:
        problem = health.fault or (None if health.status == "ok" else health.status)
        if problem is None:
            return "ok", messages
        return "error", [f"camera: {problem}", *messages]
    if not measured.is_current:
        return "unknown", messages
    if measured.reason in CAMERA_FAULTS:
        return "error", messages
    return ("unknown" if measured.y_e is None else "ok"), messages
