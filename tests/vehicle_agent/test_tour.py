"""The tour: which plans are taken, legs in order, visits, and what a restart needs."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipstream.messages import PlanAcknowledgement
from tests.vehicle_agent.road import ns
from tests.vehicle_agent.tours import VAN, continued, plan, report, sensing, stop
from vehicle_agent.tour import Tour
from vehicle_agent.tour_file import TourFile


def following(cycle: int = 1) -> Tour:
    """A tour whose plan has been accepted."""
    tour = Tour(VAN)
    answer = tour.offer(plan(cycle), ns(1))
    assert answer is not None
    assert answer.accepted
    return tour


def drive(tour: Tour, number: int, at_s: float) -> None:
    """Drive a leg of `plan` and come to its end."""
    names = {0: ("out1", "out2"), 1: ("on1",), 2: ("home1", "home2")}[number]
    for name in names:
        tour.sense(sensing(at_s, name, 10.0))
    tour.sense(sensing(at_s + 1, names[-1], on_road=False))


def refusal(answer: PlanAcknowledgement | None) -> str:
    """Why a plan was refused."""
    assert answer is not None
    assert not answer.accepted
    assert answer.reason is not None
    return answer.reason


def test_a_tour_is_driven_leg_by_leg() -> None:
    """Each leg is due when the stop before it has ended; at the depot the plan is done."""
    tour = following()
    assert tour.due_ns() == ns(60)
    drive(tour, 0, 100)
    assert tour.due_ns() is None
    assert tour.report(report(160, "served", "a"), ns(160)) is None
    assert tour.due_ns() == ns(160)
    drive(tour, 1, 200)
    tour.report(report(260, "failed", "b", "nobody there"), ns(260))
    drive(tour, 2, 300)
    assert tour.plan is None
    told = tour.progress(ns(310))
    assert [(v.stop, v.status) for v in told.visits] == [("a", "served"), ("b", "failed")]
    assert told.cycle is None


def test_a_wait_for_others_ends_when_the_plan_says() -> None:
    """Served early, it leaves as planned; served late, at once. Without a wait it leaves early."""
    whole = plan()
    place = whole.stops[1]
    early_s, late_s = 0.5 * place.departure_ns / 1e9, 2.0 * place.departure_ns / 1e9
    for wait_s, served_s, due_ns in (
        (20.0, early_s, place.departure_ns),
        (20.0, late_s, ns(late_s)),
        (0.0, early_s, ns(early_s)),
    ):
        stops = (whole.stops[0], place.model_copy(update={"wait_s": wait_s}), *whole.stops[2:])
        tour = Tour(VAN)
        tour.offer(whole.model_copy(update={"stops": stops}), ns(1))
        drive(tour, 0, served_s - 10)
        tour.report(report(served_s, "served", place.stop), ns(served_s))
        assert tour.due_ns() == due_ns


def test_nothing_is_served_at_a_hub() -> None:
    """It leaves as planned, or at once if it comes late; nobody hears of a visit."""
    whole = plan()
    hub = whole.stops[1].model_copy(update={"wait_s": 60.0, "is_hub": True})
    over_hub = whole.model_copy(update={"stops": (whole.stops[0], hub, *whole.stops[2:])})
    for arrives_s, due_s in ((110.0, 180.0), (200.0, 201.0)):
        tour = Tour(VAN)
        tour.offer(over_hub, ns(1))
        drive(tour, 0, arrives_s)
        assert tour.due_ns() == ns(due_s)
        assert tour.progress(ns(arrives_s + 1)).visits == ()
        drive(tour, 1, arrives_s + 30)
        assert tour.due_ns() is None
        assert [v.stop for v in tour.progress(ns(300)).visits] == ["b"]


def test_a_break_is_whole_however_late() -> None:
    """In time it ends as planned; later by the lateness. Agents of before see a hub."""
    whole = plan()
    pause = whole.stops[1].model_copy(update={"wait_s": 60.0, "is_hub": True, "break_s": 60.0})
    assert pause.kind == "break"
    with_pause = whole.model_copy(update={"stops": (whole.stops[0], pause, *whole.stops[2:])})
    assert [stop.stop for stop in with_pause.service_stops] == ["b"]
    for arrives_s, due_s in ((110.0, 180.0), (200.0, 261.0)):
        tour = Tour(VAN)
        tour.offer(with_pause, ns(1))
        drive(tour, 0, arrives_s)
        assert tour.due_ns() == ns(due_s)
        assert tour.progress(ns(arrives_s + 1)).visits == ()


def test_a_wait_before_a_leg_without_a_road_is_kept() -> None:
    """The next stop at the same junction is due when the wait ends."""
    whole = plan()
    place = whole.stops[1].model_copy(update={"wait_s": 60.0})
    joint = whole.model_copy(
        update={
            "stops": (whole.stops[0], place, *whole.stops[2:]),
            "segments": tuple(s for s in whole.segments if s.leg != 1),
        }
    )
    tour = Tour(VAN)
    tour.offer(joint, ns(1))
    drive(tour, 0, 100)
    tour.report(report(130, "served", "a"), ns(130))
    assert tour.due_ns() == place.departure_ns
    tour.skip(place.departure_ns)
    assert tour.standing_at is not None
    assert tour.standing_at.stop == "b"


def test_stops_at_one_junction_need_no_road() -> None:
    """A leg without segments is skipped when the stop before it has been served."""
    whole = plan()
    joint = whole.model_copy(update={"segments": tuple(s for s in whole.segments if s.leg != 1)})
    tour = Tour(VAN)
    answer = tour.offer(joint, ns(1))
    assert answer is not None
    assert answer.accepted
    drive(tour, 0, 100)
    tour.report(report(160, "served", "a"), ns(160))
    standing = tour.standing_at
    assert standing is not None
    assert standing.stop == "b"
    tour.report(report(200, "served", "b"), ns(200))
    assert tour.due_ns() == ns(200)


@pytest.mark.parametrize(
    ("offered", "reason"),
    [
        (plan(2, valid_until_ns=ns(1)), "lapsed"),
        (plan(2, stops=(stop("depot", 0, 0),), segments=()), "no stop"),
        (continued(2, 1, 1), "does not follow"),
        (plan(2, segments=plan().segments[:1] + plan().segments[1:3]), "accepted"),
    ],
)
def test_what_does_not_fit_is_refused(offered: object, reason: str) -> None:
    """In words; a plan without some leg's road is one that has no road there, and is taken."""
    answer = Tour(VAN).offer(offered, ns(5))  # type: ignore[arg-type]
    assert answer is not None
    assert reason in ("accepted" if answer.accepted else answer.reason or "")


def test_a_plan_of_an_older_dispatcher_cannot_be_driven_by() -> None:
    """Without lengths there is nothing to advise by."""
    bare = tuple(part.model_copy(update={"length_m": None}) for part in plan().segments)
    assert "road" in refusal(Tour(VAN).offer(plan(segments=bare), ns(5)))


def test_only_the_newest_plan_holds() -> None:
    """An older one is not answered; the same one is answered again."""
    tour = following(5)
    assert tour.offer(plan(4), ns(2)) is None
    again = tour.offer(plan(5), ns(3))
    assert again is not None
    assert again.accepted
    newer = tour.offer(plan(6), ns(4))
    assert newer is not None
    assert newer.accepted
    assert tour.offer(plan(7).model_copy(update={"vehicle": "other"}), ns(4)) is None


def test_a_vehicle_under_way_takes_what_continues_its_plan() -> None:
    """From the place that it left last, to the same next stop; never from the depot again."""
    tour = following(1)
    tour.sense(sensing(100, "out1", 50.0))
    assert "under way" in refusal(tour.offer(plan(2), ns(101)))
    elsewhere = continued(3, 1, 0)
    stops = (elsewhere.stops[0], elsewhere.stops[2], elsewhere.stops[1], elsewhere.stops[3])
    wrong = tour.offer(elsewhere.model_copy(update={"stops": stops}), ns(102))
    assert "on its way to a" in refusal(wrong)
    answer = tour.offer(continued(4, 1, 0), ns(103))
    assert answer is not None
    assert answer.accepted
    assert tour.state is not None
    assert (tour.leg, tour.state.segment) == (0, "out1")


def test_a_plan_made_while_the_vehicle_arrived_fits() -> None:
    """It was made for the leg that has just ended."""
    tour = following(1)
    late = continued(2, 1, 0)
    drive(tour, 0, 100)
    answer = tour.offer(late, ns(103))
    assert answer is not None
    assert answer.accepted
    standing = tour.standing_at
    assert standing is not None
    assert (tour.leg, standing.stop) == (1, "a")


def test_a_served_stop_is_not_taken_again() -> None:
    """A failed one is."""
    tour = following(1)
    drive(tour, 0, 100)
    tour.report(report(160, "served", "a"), ns(160))
    assert "a is served" in refusal(tour.offer(continued(2, 1, 0), ns(161)))
    drive(tour, 1, 200)
    tour.report(report(260, "failed", "b", "closed"), ns(260))
    drive(tour, 2, 300)
    whole = plan(3, depart_ns=ns(400))
    only_b = whole.model_copy(
        update={
            "stops": (whole.stops[0], whole.stops[2], whole.stops[3]),
            "segments": tuple(
                part.model_copy(update={"leg": max(0, part.leg - 1)}) for part in whole.segments
            ),
        }
    )
    answer = tour.offer(only_b, ns(350))
    assert answer is not None
    assert answer.accepted
    assert [visit.stop for visit in tour.progress(ns(351)).visits] == ["a"]


def test_the_driver_may_refuse_before_the_tour_begins() -> None:
    """Later, single stops may fail, but what is loaded stays on board."""
    tour = following(1)
    answer = tour.report(report(10, "refused", None, "flat tyre"), ns(10))
    assert refusal(answer) == "flat tyre"
    assert tour.plan is None
    tour = following(1)
    tour.sense(sensing(100))
    assert tour.report(report(101, "refused", None, "tired"), ns(101)) is None
    assert tour.plan is not None


def test_off_its_way_a_vehicle_has_no_place() -> None:
    """Back on it, it has one again, and never behind the one before."""
    tour = following(1)
    tour.sense(sensing(100, "out2", 10.0))
    tour.sense(sensing(101, "elsewhere"))
    assert tour.state is None
    assert tour.driving
    tour.sense(sensing(102, "out2", 80.0))
    assert tour.state is not None


def test_slack_is_what_the_tightest_stop_leaves() -> None:
    """Counted from the planned arrival; none without a limit, none when late."""
    whole = plan()
    stops = (
        whole.stops[0],
        whole.stops[1].model_copy(update={"latest_ns": ns(150)}),
        whole.stops[2].model_copy(update={"latest_ns": ns(215)}),
        whole.stops[3],
    )
    tour = Tour(VAN)
    tour.offer(whole.model_copy(update={"stops": stops}), ns(1))
    assert tour.slack_ns(ns(60)) == ns(5)
    assert tour.slack_ns(ns(62)) == ns(3)
    assert tour.slack_ns(ns(90)) == 0
    assert following().slack_ns(ns(60)) == 0


Step = st.sampled_from(["drive", "served", "restart", "plan", "again"])


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(st.lists(Step, max_size=30))
def test_a_restart_loses_nothing(steps: list[str]) -> None:
    """In any order of driving, serving and restarts each stop is served once, in order."""
    tour, now_s, cycle = following(1), 100.0, 1
    served: list[str] = []
    for step in steps:
        now_s += 10
        if tour.plan is None:
            break
        if step == "restart":
            fresh = Tour(VAN)
            fresh.resume(tour.record())
            assert fresh.record() == tour.record()
            tour = fresh
        elif step == "drive" and tour.due_ns() is not None:
            leg = tour.current
            assert leg is not None
            tour.sense(sensing(now_s, leg.path[0], 1.0))
            tour.sense(sensing(now_s + 1, leg.path[-1], on_road=False))
        elif step == "served" and tour.plan is not None:
            standing = tour.standing_at
            if standing is not None and standing.stop != "depot":
                before = len(tour.progress(0).visits)
                tour.report(report(now_s, "served", standing.stop), ns(now_s))
                if standing.stop not in served:
                    served.append(standing.stop)
                assert len(tour.progress(0).visits) == before
        elif step == "plan" and tour.under_way:
            first = tour.plan.stops[tour.leg].stop
            number = {"depot": 0, "a": 1, "b": 2}[first]
            answer = tour.offer(continued(cycle + 1, tour.plan.cycle, number), ns(now_s))
            cycle += 1
            assert answer is not None
            if answer.accepted:
                assert tour.leg == 0
        elif step == "again":
            tour.offer(tour.plan, ns(now_s))
    visits = [v.stop for v in tour.progress(0).visits if v.status == "served"]
    assert visits == served == ["a", "b"][: len(served)]


def test_a_tour_is_kept_on_disk(tmp_path: Path) -> None:
    """Written when it changes; a damaged file is set aside, and the tour begins anew."""
    tour = following(3)
    file = TourFile(tmp_path, tour)
    file.keep()
    assert not list(tmp_path.iterdir())  # nothing has changed since the file was opened
    drive(tour, 0, 100)
    file.keep()
    again = Tour(VAN)
    TourFile(tmp_path, again).load()
    assert again.record() == tour.record()
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(b"{")
    damaged = Tour(VAN)
    TourFile(tmp_path, damaged).load()
    assert damaged.plan is None
    assert kept.with_suffix(".damaged").exists()


def test_a_tour_that_cannot_be_kept_is_told_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """It is tried ten times a second; once it can be kept it is."""
    tour = following(3)
    file = TourFile(tmp_path / "tours", tour)
    drive(tour, 0, 100)
    (tmp_path / "tours").rmdir()
    for _ in range(10):
        file.keep()
    (line,) = caplog.messages
    assert line.startswith(f"the tour of {VAN} is not kept over a restart")
    (tmp_path / "tours").mkdir()
    file.keep()
    assert len(list((tmp_path / "tours").iterdir())) == 1
