"""DATEX II v3: a measurement site table and the data measured at its sites (CEN/TS 16157-5).

Each document is a `payload` of the v3 schemas. What DATEX II has no place for, the flag y_e and the
standard errors above all, stands in a level B extension: `EXTENSION_SCHEMA`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Final
from xml.etree.ElementTree import Element, SubElement, tostring

from dispatcher_daemon.service.feeds.measurements import (
    INTERMITTENT,
    SPURIOUS,
    Measurement,
    flow_vph,
    speed_cv,
)
from dispatcher_daemon.service.feeds.sites import Site, digest, iso_time, window
from dispatcher_daemon.settings import FeedSettings
from slipstream.errors import InputError
from slipstream.messages import (
    QUARTER_HOUR_S,
    CountedClass,
    Estimate,
    KinematicFeatures,
    SegmentCounts,
    SegmentState,
)

EXTENSION_SCHEMA: Final = resources.files(__package__) / "slipstream-datex2-1.xsd"
"""XML schema of the extension."""
EXTENSION_NAMESPACE: Final = "urn:slipstream:datex2:1"
TABLE_ID: Final = "slipstream"
_VERSION: Final = "3"
_NAMESPACES: Final = {
    "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
    "xmlns:d2": "http://datex2.eu/schema/3/d2Payload",
    "xmlns:com": "http://datex2.eu/schema/3/common",
    "xmlns:loc": "http://datex2.eu/schema/3/locationReferencing",
    "xmlns:roa": "http://datex2.eu/schema/3/roadTrafficData",
    "xmlns:sls": EXTENSION_NAMESPACE,
}
_NO_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_MAX_STRING: Final = 1024
_QUANTITIES: Final = ("trafficSpeed", "trafficFlow", "trafficConcentration", "trafficGap")
"""What is measured at each site; a quantity's index is its place here, from 1."""
_CLASSES: Final[Mapping[CountedClass, str]] = {
    "car": "carOrLightVehicle",
    "truck": "lorry",
    "bus": "bus",
    "motorcycle": "motorcycle",
}
"""Flows of these are counted, in this order after the quantities; then speeds at the passage."""
_CLASSES_FROM: Final = len(_QUANTITIES) + 1
_PASSAGE_SPEED: Final = _CLASSES_FROM + len(_CLASSES)
_V85_PER_CENT: Final = "85"
_MAX_ACCURACY: Final = 1e6
_KMH: Final = 3.6
_STABILITY: Final = {1: "stable", 0: "turbulent", None: "unknown"}


def site_table(sites: Sequence[Site], settings: FeedSettings, now_ns: int) -> bytes:
    """The MeasurementSiteTablePublication of the sites, as UTF-8 XML.

    Raises:
        InputError: there is no site, with which the publication is not valid.
    """
    payload = _payload("MeasurementSiteTablePublication", settings, now_ns)
    _header(payload, settings)
    table = _add(payload, "roa:measurementSiteTable", id=TABLE_ID, version=table_version(sites))
    for site in sites:
        _site(table, site)
    return _written(payload)


def measured_data(measured: Sequence[Measurement], settings: FeedSettings, now_ns: int) -> bytes:
    """The MeasuredDataPublication of what sites measure, as UTF-8 XML.

    Args:
        measured: of all sites of the table that it refers to.

    Raises:
        InputError: as `site_table`.
    """
    payload = _payload("MeasuredDataPublication", settings, now_ns)
    _add(
        payload,
        "roa:measurementSiteTableReference",
        targetClass="roa:MeasurementSiteTable",
        id=TABLE_ID,
        version=table_version([each.site for each in measured]),
    )
    _header(payload, settings)
    for each in measured:
        _site_measurements(payload, each, now_ns)
    return _written(payload)


def table_version(sites: Sequence[Site]) -> str:
    """Version of the table of these sites: another one as soon as one of them is another one.

    Raises:
        InputError: there is no site.
    """
    if not sites:
        raise InputError("feeds", "no RSU is known yet", "list them in rsus, or wait for states")
    return digest(" ".join(f"{site.id} {site.version}" for site in sites))


def _payload(kind: str, settings: FeedSettings, now_ns: int) -> Element:
    payload = Element(
        "d2:payload",
        {
            **_NAMESPACES,
            "xsi:type": f"roa:{kind}",
            "lang": "en",
            "modelBaseVersion": _VERSION,
            "extensionName": "Slipstream segment state",
            "extensionVersion": "1",
        },
    )
    _add(payload, "com:publicationTime", iso_time(now_ns))
    creator = _add(payload, "com:publicationCreator")
    _add(creator, "com:country", settings.country.lower())
    _add(creator, "com:nationalIdentifier", settings.publisher)
    return payload


def _header(payload: Element, settings: FeedSettings) -> None:
    header = _add(payload, "roa:headerInformation")
    _add(header, "com:confidentiality", "noRestriction")
    _add(header, "com:informationStatus", settings.information_status)


def _site(table: Element, site: Site) -> None:
    element = _add(table, "roa:measurementSite", id=site.id, version=site.version)
    _text(_add(element, "roa:measurementEquipmentTypeUsed"), "camera")
    _text(_add(element, "roa:measurementSiteName"), site.name)
    _add(element, "roa:measurementSiteNumberOfLanes", str(site.lanes))
    _add(element, "roa:measurementSiteIdentification", site.id)
    counted = [*(("trafficFlow", kind) for kind in _CLASSES.values()), ("trafficSpeed", None)]
    quantities = [*((quantity, None) for quantity in _QUANTITIES), *counted]
    for index, (quantity, kind) in enumerate(quantities, start=1):
        characteristics = _add(
            _add(element, "roa:measurementSpecificCharacteristics", index=str(index)),
            "roa:measurementSpecificCharacteristics",
        )
        if index >= _CLASSES_FROM:
            _add(characteristics, "roa:period", f"{QUARTER_HOUR_S:g}")
        _add(characteristics, "roa:specificMeasurementValueType", quantity)
        if kind is not None:
            vehicles = _add(characteristics, "roa:specificVehicleCharacteristics")
            _add(vehicles, "com:vehicleType", kind)
    location = _add(element, "roa:measurementSiteLocation")
    location.set("xsi:type", "loc:SingleRoadLinearLocation")
    reference = _add(location, "loc:externalReferencing")
    _add(reference, "loc:externalLocationCode", site.segment)
    _add(reference, "loc:externalReferencingSystem", "SUMO edge")
    display = _add(location, "loc:coordinatesForDisplay")
    latitude, longitude = site.middle
    _add(display, "loc:latitude", latitude)
    _add(display, "loc:longitude", longitude)
    line = _add(location, "loc:gmlLineString", srsDimension="2", srsName="EPSG:4326")
    _add(line, "loc:posList").text = " ".join(" ".join(point) for point in site.line)


def _site_measurements(payload: Element, measured: Measurement, now_ns: int) -> None:
    site, state = measured.site, measured.state
    element = _add(payload, "roa:siteMeasurements")
    _add(
        element,
        "roa:measurementSiteReference",
        targetClass="roa:MeasurementSite",
        id=site.id,
        version=site.version,
    )
    features = measured.features
    for index, quantity in enumerate(_QUANTITIES, start=1):
        if features is not None and quantity == "trafficGap" and features.mean_gap_m is None:
            continue
        if quantity == "trafficFlow" and measured.counts is not None:
            _flow(element, index, measured.counts, measured.counts.vehicles)
            continue
        single = _quantity(element, index)
        if features is None:
            _fault(single, measured, now_ns)
        else:
            data = _add(single, "roa:basicData")
            data.set("xsi:type", f"roa:{quantity[0].upper()}{quantity[1:]}")
            _value(data, quantity, features, 0 if state is None else state.vehicles)
    if measured.counts is not None:
        _counted(element, measured.counts)
    time = _add(element, "roa:measurementTimeDefault")
    if state is not None:
        _period(time, *window(state.time_ns, state.window_s))
    _extension(_add(element, "roa:_siteMeasurementsExtension"), measured)


def _quantity(site: Element, index: int) -> Element:
    """A SinglePhysicalQuantity."""
    indexed = _add(site, "roa:physicalQuantity", index=str(index))
    single = _add(indexed, "roa:physicalQuantity")
    single.set("xsi:type", "roa:SinglePhysicalQuantity")
    return single


def _period(time: Element, begin: str, end: str) -> None:
    """A MeasurementOrCalculationTime."""
    _add(time, "roa:timeMeaning", "endTime")
    _add(time, "roa:timeValue", end)
    period = _add(time, "roa:period")
    _add(period, "com:startOfPeriod", begin)
    _add(period, "com:endOfPeriod", end)


def _counted(site: Element, counts: SegmentCounts) -> None:
    """Flows by class, and speeds at the passage, of the last complete quarter hour."""
    of_classes = {one.vehicle_class: one.vehicles for one in counts.classes}
    for index, name in enumerate(_CLASSES, start=_CLASSES_FROM):
        if name in of_classes:
            _flow(site, index, counts, of_classes[name])
    if counts.mean_speed_mps is None:
        return
    data = _of_quarter_hour(site, _PASSAGE_SPEED, "trafficSpeed", counts)
    speed = _scaled(counts.mean_speed_mps, _KMH)
    element = _data_value(data, "roa:averageVehicleSpeed", speed, counts.speeds)
    _add(element, "com:speed", f"{speed.value:.6g}")
    if counts.v85_mps is not None:
        percentile = _add(data, "roa:speedPercentile")
        share = _add(percentile, "roa:vehiclePercentage")
        _add(share, "com:percentage", _V85_PER_CENT)
        v85 = _scaled(counts.v85_mps, _KMH)
        _add(
            _data_value(percentile, "roa:speedPercentile", v85, counts.speeds),
            "com:speed",
            f"{v85.value:.6g}",
        )


def _flow(site: Element, index: int, counts: SegmentCounts, vehicles: Estimate) -> None:
    """A flow as it was counted, in vehicles an hour of watched time."""
    flow = counts.flow_vph(vehicles)
    if flow is None:
        return
    data = _of_quarter_hour(site, index, "trafficFlow", counts)
    element = _data_value(data, "roa:vehicleFlow", flow, round(vehicles.value))
    _add(element, "com:vehicleFlowRate", str(round(flow.value)))


def _of_quarter_hour(site: Element, index: int, quantity: str, counts: SegmentCounts) -> Element:
    """Data with a time of their own."""
    data = _add(_quantity(site, index), "roa:basicData")
    data.set("xsi:type", f"roa:{quantity[0].upper()}{quantity[1:]}")
    time = _add(data, "roa:measurementOrCalculationTime")
    _period(time, iso_time(counts.began_ns), iso_time(counts.until_ns))
    return data


def _fault(quantity: Element, measured: Measurement, now_ns: int) -> None:
    """Why there is no value: DATEX II marks a value as faulty only where one is given."""
    reason = measured.missing
    kind = "noDataValuesAvailable"
    if reason in INTERMITTENT:
        kind = "intermittentDataValues"
    elif reason in SPURIOUS:
        kind = "spuriousUnreliableDataValues"
    told_ns = now_ns if measured.state is None else measured.state.time_ns
    fault = _add(quantity, "roa:physicalQuantityFault")
    _text(_add(fault, "com:faultDescription"), reason)
    _add(fault, "com:faultLastUpdateTime", iso_time(told_ns))
    _add(fault, "roa:physicalQuantityFaultType", kind)


def _value(data: Element, quantity: str, features: KinematicFeatures, vehicles: int) -> None:
    if quantity == "trafficSpeed":
        speed = _scaled(features.mean_speed_mps, _KMH)
        element = _data_value(data, "roa:averageVehicleSpeed", speed, vehicles)
        element.set("standardDeviation", f"{_KMH * features.speed_std_mps.value:.6g}")
        _add(element, "com:speed", f"{max(0.0, speed.value):.6g}")
    elif quantity == "trafficFlow":
        flow = flow_vph(features)
        element = _data_value(data, "roa:vehicleFlow", flow, vehicles)
        _add(element, "com:vehicleFlowRate", str(round(flow.value)))
    elif quantity == "trafficConcentration":
        density = _scaled(features.density_veh_per_m, 1000.0)
        element = _data_value(data, "roa:density", density, vehicles)
        _add(element, "roa:densityOfVehicles", str(round(density.value)))
    elif features.mean_gap_m is not None:
        gap = features.mean_gap_m
        element = _data_value(data, "roa:averageDistanceGap", gap, None)
        _add(element, "com:distance", f"{max(0.0, gap.value):.6g}")


def _data_value(data: Element, tag: str, value: Estimate, vehicles: int | None) -> Element:
    """An element of a DataValue; its accuracy is the standard error in per cent of the value."""
    element = _add(data, tag)
    error = value.standard_error
    # In per cent of next to nothing it says nothing; the extension has it as it is.
    if error is not None and 100.0 * error < _MAX_ACCURACY * value.value:
        element.set("accuracy", f"{100.0 * error / value.value:.6g}")
    element.set("computationalMethod", "arithmeticAverageOfSamplesInATimePeriod")
    if vehicles is not None:
        element.set("numberOfInputValuesUsed", str(vehicles))
    return element


def _extension(parent: Element, measured: Measurement) -> None:
    element = _add(parent, "sls:segmentState")
    _add(element, "sls:stability", _STABILITY[measured.y_e])
    if measured.reason is not None:
        _add(element, "sls:reason", measured.reason)
    if measured.state is not None and measured.is_current:
        _counts(element, measured.state)
    if measured.features is not None:
        for name, estimate in _estimates(measured.features):
            value = _add(element, f"sls:{name}", repr(estimate.value))
            if estimate.standard_error is not None:
                value.set("standardError", repr(estimate.standard_error))


def _counts(element: Element, state: SegmentState) -> None:
    _add(element, "sls:vehicles", str(state.vehicles))
    _add(element, "sls:frames", str(state.frames))
    _add(element, "sls:coverage", repr(state.coverage))


def _estimates(features: KinematicFeatures) -> Iterable[tuple[str, Estimate]]:
    """Name and figure of what was measured, in the order of the schema."""
    yield "meanSpeedMps", features.mean_speed_mps
    yield "speedStdMps", features.speed_std_mps
    cv = speed_cv(features)
    if cv is not None:
        yield "speedCv", cv
    yield "meanAccelerationMps2", features.mean_acceleration_mps2
    yield "accelerationVarianceM2ps4", features.acceleration_variance_m2ps4
    yield "densityVehPerM", features.density_veh_per_m
    yield "flowVehPerH", flow_vph(features)
    if features.mean_gap_m is not None:
        yield "meanGapM", features.mean_gap_m


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    error = estimate.standard_error
    return Estimate(
        value=factor * estimate.value, standard_error=None if error is None else factor * error
    )


def _add(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    element = SubElement(parent, tag, attributes)
    if text is not None:
        element.text = _NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)[:_MAX_STRING]
    return element


def _text(parent: Element, text: str) -> None:
    """A MultilingualString."""
    values = _add(parent, "com:values")
    _add(values, "com:value", text, lang="en")


def _written(payload: Element) -> bytes:
    text: bytes = tostring(payload, encoding="utf-8")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + text + b"\n"
