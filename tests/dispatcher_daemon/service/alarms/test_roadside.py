"""RSUs that fall silent, lose their picture, clock or states; vehicles that stand."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.alarms import RoadsideWatch
from dispatcher_daemon.service.alarms.conditions import STARTED_S
from dispatcher_daemon.service.alarms.roadside import MISSED_LEAST, WINDOW_S, MissedRates
from dispatcher_daemon.traffic.reception import Reception
from slipstream.errors import InputError
from slipstream.messages import (
    RsuHealth,
    SegmentState,
    StoppedVehicle,
    StoppedVehicles,
    stopped_key,
)
from tests.dispatcher_daemon.service.feeds.states import health as rsu_health
from tests.dispatcher_daemon.service.feeds.states import state

NOW_NS = 1_800_000_000_000_000_000
SILENT_S = 5.0


class Roadside:
    """A watch with a clock of its own."""

    def __init__(self, demo: RoutingProblem, rsus: dict[str, tuple[str, ...]] | None = None):
        self.now_s = 0.0
        self.refused: list[InputError] = []
        self.healths: dict[str, tuple[int, RsuHealth]] = {}
        self.states: list[SegmentState] = []
        self.watch = RoadsideWatch(
            demo.network,
            rsus,
            SILENT_S,
            lambda: self.healths,
            self.refused.append,
            lambda: self.now_ns,
            lambda: self.states,
        )

    @property
    def now_ns(self) -> int:
        return NOW_NS + round(self.now_s * 1e9)

    def hear(self, rsu: str = "a", **changes: Any) -> None:
        """A health comes in."""
        health = rsu_health(rsu, **{"time_ns": self.now_ns, "source": "rtsp://a", **changes})
        self.healths[rsu] = self.now_ns, health

    def know(self, reason: str = "uncertain") -> None:
        """A state of a road comes in; unknown for a reason."""
        known = state(y_e=None, reason=reason, rsu="a")
        self.states = [replace(known, time_ns=self.now_ns)]

    def see(self, *stopped_s: float, segment: str = "avenue_east", y_e: int | None = 1) -> None:
        """Vehicles stand since some seconds ago."""
        vehicles = tuple(
            StoppedVehicle(
                lane=0, along_m=35.0, since_ns=self.now_ns - round(s * 1e9), seen_ns=self.now_ns
            )
            for s in stopped_s
        )
        seen = StoppedVehicles(
            rsu="a",
            segment=segment,
            time_ns=self.now_ns,
            vehicles=vehicles,
            y_e=y_e,  # type: ignore[arg-type]
            mean_speed_mps=None,
        )
        self.watch.on_stopped(stopped_key("a", segment), seen.to_bytes())

    def found(self, receptions: tuple[tuple[str, Reception], ...] = ()) -> list[tuple[str, str]]:
        """Kind and text of each condition."""
        return [(c.kind, c.text) for c in self.watch.conditions(receptions, self.now_s)]

    def kinds(self, receptions: tuple[tuple[str, Reception], ...] = ()) -> list[str]:
        """Kinds only."""
        return [kind for kind, _ in self.found(receptions)]


@pytest.fixture
def roadside(demo: RoutingProblem) -> Roadside:
    """Any RSU may report."""
    return Roadside(demo)


def test_an_rsu_that_falls_silent(roadside: Roadside) -> None:
    """As soon as its states are stale; a recording that has ended is not silent."""
    roadside.hear("a")
    roadside.hear("over", status="ended")
    roadside.now_s = SILENT_S
    assert roadside.kinds() == []
    roadside.now_s += 0.1
    assert roadside.found() == [("rsu_silent", "last heard of at 2027-01-15T08:00:00Z")]
    roadside.hear("a")
    assert roadside.kinds() == []


def test_a_listed_rsu_that_never_came(demo: RoutingProblem) -> None:
    """It is missed soon after the start, and for ever."""
    roadside = Roadside(demo, {"a": ("avenue_east",), "b": ("avenue_west",)})
    roadside.hear("a")
    roadside.know()
    assert roadside.kinds() == []
    roadside.now_s = STARTED_S + 1
    roadside.hear("a")
    roadside.know()
    (only,) = roadside.watch.conditions((), roadside.now_s)
    assert (only.kind, only.subject, only.since_ns) == ("rsu_silent", "rsu/b", NOW_NS)
    roadside.now_s += 2 * 86_400.0
    told = [c.subject for c in roadside.watch.conditions((), 0.0)]
    assert told == ["dispatcher", "rsu/b", "rsu/a"]


def test_no_listed_rsu_sees_its_road(demo: RoutingProblem) -> None:
    """It is awaited after a start, and an alarm at once where states were there; one without a
    picture sees nothing, one that knows too little does.
    """
    roadside = Roadside(demo, {"a": ("avenue_east",), "b": ("avenue_west",)})

    def lost() -> list[bool]:
        found = [c for c in roadside.watch.conditions((), 0.0) if c.kind == "rsus_lost"]
        assert all("(a, b)" in one.text for one in found)
        return [one.awaited for one in found]

    assert lost() == [True]
    roadside.know("too_few_vehicles")
    assert lost() == []
    roadside.know("stale")
    assert lost() == [False]
    roadside.know()
    roadside.now_s = SILENT_S + 0.1
    assert lost() == [False]
    roadside = Roadside(demo, {"a": ("avenue_east",), "b": ("avenue_west",)})
    roadside.now_s = STARTED_S
    roadside.know("no_frames")
    assert lost() == [True]
    roadside.now_s += 0.1
    assert lost() == [False]


def test_who_drives_the_wrong_way_is_told_once_a_road_while_it_is_seen(
    demo: RoutingProblem,
) -> None:
    """Two RSUs see it; a state that is stale tells nothing any more."""
    roadside = Roadside(demo)
    roadside.know("wrong_way")
    roadside.states.append(replace(roadside.states[0], rsu="b"))
    (only,) = roadside.watch.conditions((), 0.0)
    assert (only.kind, only.subject) == ("wrong_way", f"road/{roadside.states[0].segment}")
    assert "seen by a" in only.text
    roadside.know("opposite_direction")
    assert roadside.kinds() == []
    roadside.know("wrong_way")
    roadside.now_s = SILENT_S + 1
    assert roadside.kinds() == []


@pytest.mark.parametrize("rsus", [None, {}])
def test_where_no_rsu_is_configured_none_is_lost(demo: RoutingProblem, rsus: Any) -> None:
    """However long none is heard."""
    roadside = Roadside(demo, rsus)
    roadside.now_s = 10 * STARTED_S
    assert roadside.kinds() == []


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"status": "no_signal", "fault": "stale"}, [("rsu_no_signal", "rtsp://a")]),
        ({"fault": "camera_moved"}, [("camera_fault", "camera moved")]),
        (
            {"status": "no_signal", "fault": "dark"},
            [("rsu_no_signal", ""), ("camera_fault", "dark")],
        ),
    ],
)
def test_what_an_rsu_says_of_itself(
    roadside: Roadside, changes: dict[str, Any], expected: list[tuple[str, str]]
) -> None:
    """While it is heard."""
    roadside.hear("a", **changes)
    found = roadside.found()
    assert [kind for kind, _ in found] == [kind for kind, _ in expected]
    assert all(word in text for (_, text), (_, word) in zip(found, expected, strict=True))
    roadside.now_s += SILENT_S + 1
    assert roadside.kinds() == ["rsu_silent"]


@pytest.mark.parametrize(
    ("delay_s", "words"),
    [(0.4, None), (-0.4, None), (-0.6, "0.6 s ahead"), (3.0, "3.0 s after their time")],
)
def test_a_clock_that_is_off(roadside: Roadside, delay_s: float, words: str | None) -> None:
    """By more than what a link and a picture take."""
    roadside.hear("a")
    found = roadside.found((("a", Reception(100, 0, 0, 0, delay_s, 0.1)),))
    assert [kind for kind, _ in found] == ([] if words is None else ["rsu_clock"])
    assert words is None or words in found[0][1]


def test_states_that_do_not_come(roadside: Roadside) -> None:
    """A tenth of the last minute's; those missed long ago do not count."""

    def after(second: float, received: int, missed: int) -> list[str]:
        roadside.now_s = second
        roadside.hear("a")
        return roadside.kinds((("a", Reception(received, missed, 0, 0, 0.1, 0.1)),))

    assert after(0, 1000, 500) == []
    assert after(20, 1020, 500 + MISSED_LEAST - 1) == []
    assert after(30, 1030, 500 + MISSED_LEAST) == ["rsu_states_missed"]
    assert after(40, 1400, 500 + MISSED_LEAST) == []
    assert after(30 + 2 * WINDOW_S, 1500, 500 + MISSED_LEAST) == []


def test_rates_of_a_new_rsu_and_of_one_that_comes_late() -> None:
    """They begin with what is known, and a late state is none missed."""
    rates = MissedRates()
    assert rates.update((("a", Reception(9, 9, 0, 0, None, None)),), 0.0) == {}
    assert rates.update((("a", Reception(19, 4, 0, 0, None, None)),), 5.0) == {}
    assert rates.update((("a", Reception(29, 12, 0, 0, None, None)),), 9.0) == {"a": (3, 23)}


def test_vehicles_that_stand(roadside: Roadside) -> None:
    """Where traffic is stable at once, else after the time of a red light; until they have gone."""
    roadside.see(3.0, 60.0)
    (found,) = roadside.watch.conditions((), 0.0)
    assert (found.kind, found.subject) == ("vehicle_stopped", "road/avenue_east")
    assert "and 1 more" in found.text
    assert "lane 1, 35 m" in found.text
    assert found.since_ns == NOW_NS - 60 * 10**9
    roadside.see(3.0, y_e=0)
    assert roadside.kinds() == []
    roadside.see(200.0, y_e=0)
    assert roadside.kinds() == ["vehicle_stopped"]
    roadside.see()
    assert roadside.kinds() == []
    roadside.see(200.0)
    roadside.now_s += SILENT_S + 1
    assert roadside.kinds() == []


def test_what_is_no_message_is_refused(roadside: Roadside) -> None:
    """A wrong key, an unknown road, garbage: each counted, none kept."""
    watch = roadside.watch
    watch.on_stopped(stopped_key("a", "avenue_east"), b"{}")
    roadside.see(9.0, segment="nowhere")
    assert len(roadside.refused) == 2
    roadside.now_s = 1e6
    assert roadside.kinds() == []
