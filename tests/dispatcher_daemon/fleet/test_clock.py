"""Clock times in fleet files: the seconds that they are in a cycle, and what is refused."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest

from dispatcher_daemon.fleet import Fleet, fleet_from
from dispatcher_daemon.fleet.clock import seconds_after
from dispatcher_daemon.fleet.file import FleetFile
from dispatcher_daemon.fleet.tracking.order_stops import details, outside_windows
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network

BERLIN = ZoneInfo("Europe/Berlin")


def ns(text: str) -> int:
    """UTC ns of a moment in Berlin, or with a zone of its own."""
    at = datetime.fromisoformat(text)
    return round(1e9 * (at if at.tzinfo else at.replace(tzinfo=BERLIN)).timestamp())


@pytest.fixture(scope="module")
def roads() -> RoadNetwork:
    """The demo's."""
    return load_network("demo")


@pytest.mark.parametrize(
    ("clocks", "now", "expected"),
    [
        ({"earliest": "08:30"}, "2026-11-23T08:00", {"earliest": 1800.0}),
        ({"earliest": "08:30"}, "2026-11-23T09:00", {"earliest": -1800.0}),
        ({"a": "2026-11-23T08:30:00+01:00"}, "2026-11-23T08:00", {"a": 1800.0}),
        ({"a": "2026-11-23T08:30:00+00:00"}, "2026-11-23T08:00", {"a": 5400.0}),
        ({"a": "2026-11-24T08:00:00"}, "2026-11-23T08:00", {"a": 86400.0}),
        # Over midnight: from the evening before, until it has passed.
        ({"a": "22:00", "b": "06:00"}, "2026-11-23T23:00", {"a": -3600.0, "b": 25200.0}),
        ({"a": "22:00", "b": "06:00"}, "2026-11-24T01:00", {"a": -10800.0, "b": 18000.0}),
        ({"a": "22:00", "b": "06:00"}, "2026-11-24T07:00", {"a": 54000.0, "b": 82800.0}),
        # A lone end in the night is that of the coming one, from the morning on.
        ({"return_by": "00:30"}, "2026-11-23T18:00", {"return_by": 6.5 * 3600}),
        ({"return_by": "00:30"}, "2026-11-23T04:00", {"return_by": 20.5 * 3600}),
        ({"return_by": "00:30"}, "2026-11-24T00:10", {"return_by": 1200.0}),
        ({"return_by": "00:30"}, "2026-11-24T01:00", {"return_by": -1800.0}),
        ({"latest": "00:00"}, "2026-11-23T20:00", {"latest": 4 * 3600.0}),
        ({"depart_by": "06:00"}, "2026-11-23T20:00", {"depart_by": 10 * 3600.0}),
        (
            {"earliest": "00:30", "latest": "02:00"},
            "2026-11-23T23:30",
            {"earliest": 3600.0, "latest": 9000.0},
        ),
        ({"earliest": "00:30"}, "2026-11-23T23:50", {"earliest": 2400.0}),
        # What has passed in the day has passed; a begin holds from then on.
        ({"latest": "09:00"}, "2026-11-23T10:00", {"latest": -3600.0}),
        ({"return_by": "18:00"}, "2026-11-23T23:00", {"return_by": -5 * 3600.0}),
        ({"ready": "07:00"}, "2026-11-23T20:00", {"ready": -13 * 3600.0}),
        ({"ready": "03:00"}, "2026-11-23T10:00", {"ready": -7 * 3600.0}),
        (
            {"earliest": "00:00", "latest": "18:00"},
            "2026-11-23T19:00",
            {"earliest": -19 * 3600.0, "latest": -3600.0},
        ),
        # The end of the day.
        ({"latest": "24:00"}, "2026-11-23T20:00", {"latest": 4 * 3600.0}),
        ({"latest": "24:00"}, "2026-11-24T00:10", {"latest": 86400.0 - 600}),
        (
            {"earliest": "08:00", "latest": "24:00"},
            "2026-11-23T20:00",
            {"earliest": -12 * 3600.0, "latest": 4 * 3600.0},
        ),
        (
            {"earliest": "00:00", "latest": "24:00"},
            "2026-11-23T20:00",
            {"earliest": -20 * 3600.0, "latest": 4 * 3600.0},
        ),
        ({"a": "2026-11-23T24:00:00+01:00"}, "2026-11-23T20:00", {"a": 4 * 3600.0}),
        # The night of the change to winter time has an hour more, and 02:30 twice: the first.
        ({"return_by": "03:30"}, "2026-10-24T18:00", {"return_by": 10.5 * 3600}),
        ({"return_by": "02:30"}, "2026-10-24T18:00", {"return_by": 8.5 * 3600}),
        # In spring there is no 02:30: it is 03:30 of summer time.
        ({"return_by": "02:30"}, "2026-03-28T18:00", {"return_by": 8.5 * 3600}),
        # The night of the change to summer time has an hour less.
        ({"a": "06:00"}, "2026-03-29T01:00", {"a": 4 * 3600.0}),
    ],
)
def test_seconds_count_from_the_moment(
    clocks: dict[str, str], now: str, expected: dict[str, float]
) -> None:
    """In the fleet's zone, of the day that it is there."""
    assert seconds_after(clocks, BERLIN, ns(now)) == pytest.approx(expected)


def test_a_break_of_a_night_shift_is_in_it(tmp_path: Path, roads: RoadNetwork) -> None:
    """Before the shift begins, before midnight and after it; one before midnight too."""
    path = _file(
        tmp_path,
        '[[vehicles]]\nid = "v"\nready = "22:00"\nreturn_by = "07:00"\n'
        'breaks = [{duration_s = 900, earliest = "23:00", latest = "23:30"}, '
        '{duration_s = 900, earliest = "05:00", latest = "05:30"}]\n',
    )
    file = FleetFile(str(path), roads)
    for now, hours in (("23T21:00", 0), ("23T22:30", 1.5), ("24T01:00", 4), ("24T06:00", 9)):
        fleet = file.current(ns(f"2026-11-{now}"))
        assert fleet is not None
        begins = [own.earliest_s / 3600 for own in fleet.vehicles[0].breaks]
        assert begins == [2 - hours, 8 - hours], now


def test_breaks_of_a_list_stay_in_its_order(tmp_path: Path, roads: RoadNetwork) -> None:
    """One that has passed in the morning is not tomorrow's while another one is today's."""
    path = _file(
        tmp_path,
        '[[vehicles]]\nid = "v"\nready = "06:00"\nreturn_by = "23:00"\n'
        'breaks = [{duration_s = 900, earliest = "08:00", latest = "08:30"}, '
        '{duration_s = 900, earliest = "18:00", latest = "19:00"}]\n',
    )
    fleet = FleetFile(str(path), roads).current(ns("2026-11-23T21:00"))
    assert fleet is not None
    assert [own.earliest_s / 3600 for own in fleet.vehicles[0].breaks] == [-13, -3]


def test_times_that_contradict_each_other_are_refused(tmp_path: Path, roads: RoadNetwork) -> None:
    """A tour that has to end before it may begin, within the day that follows `ready`."""
    path = _file(
        tmp_path,
        '[[vehicles]]\nid = "v"\nready = "22:00"\ndepart_by = "02:00"\nreturn_by = "01:00"\n',
    )
    with pytest.raises(InputError, match=r"return_by \(01:00\) is before depart_by \(02:00\)"):
        FleetFile(str(path), roads)


def _file(folder: Path, text: str) -> Path:
    path = folder / "fleet.toml"
    path.write_text('time_zone = "Europe/Berlin"\n[[depots]]\nnode = "depot"\n' + text)
    return path


def test_each_cycle_has_the_seconds_of_its_own_moment(tmp_path: Path, roads: RoadNetwork) -> None:
    """The file is read once; TOML's own times are read too."""
    path = _file(
        tmp_path,
        '[[stops]]\nid = "s"\nnode = "c1"\nearliest = "08:30"\nlatest = 09:00:00\n'
        '[[vehicles]]\nid = "v"\nready = "07:00"\ndepart_by = "08:00"\n'
        "return_by = 2026-11-23T17:00:00+01:00\n",
    )
    file = FleetFile(str(path), roads)
    early = file.current(ns("2026-11-23T06:00"))
    late = file.current(ns("2026-11-23T08:45"))
    assert early is not None
    assert late is not None
    assert (early.stops[0].earliest_s, early.stops[0].latest_s) == (9000.0, 10800.0)
    assert (late.stops[0].earliest_s, late.stops[0].latest_s) == (0.0, 900.0)
    times = [
        (v.ready_s, v.depart_by_s, v.return_by_s) for v in (early.vehicles[0], late.vehicles[0])
    ]
    assert times == [(3600.0, 7200.0, 39600.0), (0.0, 0.0, 29700.0)]


def test_a_stop_is_planned_neither_long_before_its_window_nor_after_it(
    tmp_path: Path, roads: RoadNetwork
) -> None:
    """As orders of callers; seconds are as ever."""
    path = _file(
        tmp_path,
        '[[stops]]\nid = "s"\nnode = "c1"\nearliest = "12:00"\nlatest = "13:00"\n'
        '[[stops]]\nid = "t"\nnode = "c2"\nearliest_s = 20000.0\n'
        '[[vehicles]]\nid = "v"\n',
    )
    file = FleetFile(str(path), roads)
    reasons = {}
    for now in ("2026-11-23T08:00", "2026-11-23T10:30", "2026-11-23T13:30"):
        fleet = file.current(ns(now))
        assert fleet is not None
        reasons[now[11:]] = outside_windows(fleet, ns(now), 7200.0)
    assert reasons["08:00"].keys() == {"s"}
    assert "planned from 2026-11-23T09:00" in reasons["08:00"]["s"]
    assert reasons["10:30"] == {}
    assert reasons["13:30"] == {"s": "its window closes before a plan can be out"}


@pytest.mark.parametrize("odd_ns", [0, 1, 123_456_789, 999_999_999])
def test_windows_by_the_clock_are_exact_in_utc(
    tmp_path: Path, roads: RoadNetwork, odd_ns: int
) -> None:
    """21:00 is 21:00 whenever a cycle is, and a window that is open has the begin that it had."""
    stop = '[[stops]]\nid = "s"\nnode = "c1"\nearliest = "08:00"\nlatest = "21:00"\n'
    path = _file(tmp_path, f'{stop}[[vehicles]]\nid = "van-1"\n')
    for now in ("2026-11-23T07:00", "2026-11-23T12:00"):
        reference_ns = ns(now) + odd_ns
        fleet = FleetFile(str(path), roads).current(reference_ns)
        assert fleet is not None
        found = details(fleet.stops[0], reference_ns)
        assert found["earliest_ns"] == ns("2026-11-23T08:00")
        assert found["latest_ns"] == ns("2026-11-23T21:00")
        latest_s = fleet.stops[0].latest_s
        assert latest_s is not None
        assert reference_ns + round(1e9 * latest_s) == ns("2026-11-23T21:00")


def test_a_fleet_without_clock_times_stays_the_same_object(roads: RoadNetwork) -> None:
    """Nothing is copied for those who count in seconds."""
    rows = {"depots": [{"node": "depot"}], "vehicles": [{"id": "v"}]}
    fleet = fleet_from(rows, roads, "test", may_lack_stops=True)
    assert fleet.at(ns("2026-11-23T08:00")) is fleet


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ('earliest = "25:00"', 'stops.s.earliest: no clock time, write "08:30"'),
        ('earliest = "2026-11-23"', "stops.s.earliest: no clock time"),
        ('latest = "09:00"\nlatest_s = 3.0', "stops.s.latest: latest_s is given too"),
        ("earliest = 830", "stops.s.earliest: "),
    ],
)
def test_what_is_no_clock_time_is_one_line(
    row: str, said: str, tmp_path: Path, roads: RoadNetwork
) -> None:
    """File, stop and key."""
    path = _file(tmp_path, f'[[stops]]\nid = "s"\nnode = "c1"\n{row}\n[[vehicles]]\nid = "v"\n')
    with pytest.raises(InputError) as refused:
        FleetFile(str(path), roads)
    assert f"{path}: {said}" in str(refused.value)


def test_an_unknown_zone_and_times_of_no_file_are_refused(
    tmp_path: Path, roads: RoadNetwork
) -> None:
    """An instance's times count from its begin, which has no clock."""
    path = tmp_path / "fleet.toml"
    path.write_text('time_zone = "Mars/Olympus"\n[[depots]]\nnode="depot"\n[[vehicles]]\nid="v"\n')
    with pytest.raises(InputError, match="time_zone: no time zone that this machine knows"):
        FleetFile(str(path), roads)
    rows = {"depots": [{"node": "depot"}], "vehicles": [{"id": "v", "ready": "08:00"}]}
    with pytest.raises(
        InputError, match=r"vehicles\.v\.ready: a clock time, which only a fleet file"
    ):
        fleet_from(rows, roads, "request", may_lack_stops=True)
    assert isinstance(
        fleet_from(rows, roads, "f", may_lack_stops=True, may_have_clock_times=True), Fleet
    )
