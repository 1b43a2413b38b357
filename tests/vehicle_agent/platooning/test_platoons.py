"""Platoons on a road of two and more vehicles: they form, keep, part, and part when in doubt."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from slipstream.braking import BRAKING
from slipstream.energy.consumption import PAPER_CAR
from slipstream.energy.traction import coasting_mps2
from slipstream.messages import PlannedCrossing, PlatoonControl
from slipstream.spacing import CLOSE_GAP_M, least_gap_m
from tests.vehicle_agent.platooning.world import (
    IDEAL,
    LENGTH_M,
    Car,
    Roadside,
    World,
    planned,
    platooning_of,
    road,
    string,
)
from vehicle_agent.leg import Leg
from vehicle_agent.platooning import PlatoonStep

LIMIT = 30.0
MODES = [pytest.param(0.1, True, id="live"), pytest.param(0.5, False, id="evaluation")]


def is_close(world: World, name: str = "v1") -> bool:
    """Whether it follows at the gap that it wants."""
    step = world.car(name).last
    gap_m = least_gap_m(world.car(name).speed_mps, 9.0, IDEAL, world.interval_s)
    return step is not None and step.close and world.gap_m(name) < gap_m + 0.6


def pair(interval_s: float = 0.1, *, delayed: bool = True, gap_m: float = 20.0) -> World:
    """Two vehicles that have become a platoon."""
    world = World(string(2, None, gap_m, 28.0), interval_s, delayed)
    assert world.run(60.0, lambda: is_close(world) and world.car("v0").speed_mps > 29.0)
    return world


def hardest(speeds: list[float], interval_s: float) -> float:
    """Largest deceleration, m/s²."""
    return max((s - t) / interval_s for s, t in pairwise(speeds))


@pytest.mark.parametrize(("interval_s", "delayed"), MODES)
def test_vehicles_apart_come_together(interval_s: float, delayed: bool) -> None:
    """The front one waits, by 15 % at most, the rear one keeps the limit; then both are a platoon.

    Nothing that went into catching up is braked away.
    """
    world = World(string(2, None, 150.0, 29.0), interval_s, delayed)
    assert world.run(120.0, lambda: is_close(world))
    assert max(world.speeds["v1"]) <= LIMIT + 1e-9
    assert min(world.speeds["v0"]) >= 0.85 * LIMIT - 0.1
    assert hardest(world.speeds["v0"], interval_s) < 0.45
    assert hardest(world.speeds["v1"], interval_s) < 1.5
    world.run(30.0)
    rear, front = world.car("v1").last, world.car("v0").last
    assert rear is not None
    assert front is not None
    assert (rear.mode, rear.partner, rear.control.leader) == ("following", "v0", "v0")
    assert (front.mode, front.cruise_mps, front.control.joined_by) == ("alone", None, None)
    assert front.tail_m == pytest.approx(2 * LENGTH_M + world.gap_m("v1"), abs=0.05)
    assert rear.gap_m is not None
    assert world.gap_m("v1") == pytest.approx(rear.gap_m, abs=0.1)
    assert front.control.limit_mps2 == pytest.approx(rear.control.needs_mps2)


@pytest.mark.parametrize(("interval_s", "delayed"), MODES)
def test_three_become_one_platoon(interval_s: float, delayed: bool) -> None:
    """Whoever catches up is waited for by the leader; each vehicle by one at a time."""
    world = World(string(3, None, 60.0, 29.0, road(length_m=2000.0)), interval_s, delayed)
    assert world.run(300.0, lambda: is_close(world, "v1") and is_close(world, "v2"))
    world.run(15.0)
    step = world.car("v2").last
    front = world.car("v0").last
    assert step is not None
    assert front is not None
    assert (step.partner, step.control.leader) == ("v1", "v0")
    gaps = world.gap_m("v1") + world.gap_m("v2")
    assert front.tail_m == pytest.approx(3 * LENGTH_M + gaps, abs=0.1)


@pytest.mark.long
@pytest.mark.parametrize(("interval_s", "delayed"), MODES)
def test_a_leader_waits_until_all_gaps_behind_it_are_closed(
    interval_s: float, delayed: bool
) -> None:
    """For all of them at once, and not for one after the other; then it drives at the limit."""
    world = World(string(5, None, 60.0, 29.0, road(length_m=3000.0)), interval_s, delayed)
    names = [f"v{number}" for number in range(1, 5)]
    assert world.run(200.0, lambda: all(is_close(world, name) for name in names))
    assert all(hardest(world.speeds[name], interval_s) < 1.5 for name in ("v0", *names))
    assert min(world.speeds["v0"]) >= 0.85 * LIMIT - 0.1
    gates = world.gates
    gates.closed.update("abcdefghij"[world.car("v4").state().number + 1 :][:1])
    closed_from = world.steps
    assert world.run(200.0, lambda: all(world.gap_m(name) > 15.0 for name in names))
    gates.closed.clear()
    begin = world.steps
    assert begin > closed_from
    assert world.run(120.0, lambda: all(is_close(world, name) for name in names))
    slow = [speed < 0.95 * LIMIT for speed in world.speeds["v0"][begin:]]
    assert sum(one != other for one, other in pairwise(slow)) <= 2  # it does not speed up between
    world.run(30.0)
    assert world.car("v0").speed_mps == pytest.approx(LIMIT, abs=0.1)


@pytest.mark.parametrize(("interval_s", "delayed"), MODES)
def test_a_leader_drives_what_it_announces(interval_s: float, delayed: bool) -> None:
    """On a road for overtaking, once somebody follows it; alone it does as its driver likes."""
    world = pair(interval_s, delayed=delayed)
    for _ in range(round(5.0 / interval_s)):
        world.step()
        leader = world.car("v0").last
        assert leader is not None
        assert leader.lead_mps == leader.control.announced_mps
        assert world.car("v0").speed_mps == leader.lead_mps
    alone = World(string(1, None, 0.0, 28.0), interval_s, delayed)
    alone.run(1.0)
    assert alone.car("v0").last is not None
    assert alone.car("v0").last.lead_mps is None


def test_a_leader_promises_nothing_with_a_vehicle_near_ahead() -> None:
    """Who cuts in before it takes the room that it needs: its follower is told, and it is commanded
    within what it has promised until that one is apart.
    """
    world = pair(0.5, delayed=False)
    world.step()
    leader = world.car("v0")
    assert leader.last is not None
    assert leader.last.lead_mps is not None
    cut_in = Car("x", leader.place_m + 25.0, leader.speed_mps, leader.leg, lambda _: 30.0, False)
    world.cars.insert(0, cut_in)
    world.step()
    assert leader.last.control.limit_mps2 is None
    assert leader.last.lead_mps is not None
    assert leader.platooning is not None
    assert leader.platooning.limit_mps2 is not None


@pytest.mark.parametrize("traffic_mps", [19.5, 20.0])
def test_a_leader_behind_slower_traffic_keeps_its_promise(traffic_mps: float) -> None:
    """It coasts before it is as near as the promise allows, so that its follower stays close."""
    leg = road(limit_mps=23.0)
    world = World(string(2, None, 20.0, 20.7, leg), 0.5, delayed=False)
    for car in world.cars:
        braking = BRAKING["car"].on("dry")
        car.platooning = platooning_of(0.5, pace=0.9, name=car.name, braking=braking)
    leader, follower = world.cars
    begin_m = leader.place_m + 150.0
    world.cars.insert(0, Car("x", begin_m, traffic_mps, leg, lambda _: traffic_mps, False))
    world.run(200.0)
    assert set(world.modes["v1"]) == {"following"}
    assert leader.last is not None
    assert leader.last.control.limit_mps2 is not None
    # Where it needs more room than its sensors reach, it loses sight and gains it again.
    assert leader.speed_mps == pytest.approx(traffic_mps, abs=0.5)
    assert follower.speed_mps == pytest.approx(leader.speed_mps, abs=0.1)
    assert world.gap_m("v1") < 2.6


@pytest.mark.parametrize(("interval_s", "delayed"), MODES)
@pytest.mark.parametrize("name", ["v0", "v1"])
def test_with_ordinary_brakes_platoons_coast_as_the_rest_of_the_agent_asks(
    interval_s: float, delayed: bool, name: str
) -> None:
    """Leader or follower: 5 s of rolling, no brake, whatever is under way in brake and drive."""
    world = World(string(2, None, 20.0, 28.0), interval_s, delayed)
    for car in world.cars:
        car.platooning = platooning_of(interval_s, name=car.name, braking=BRAKING["car"].on("dry"))
    assert world.run(60.0, lambda: world.gap_m("v1") < 3.0 and world.car("v0").speed_mps > 29.0)
    car = world.car(name)
    assert car.platooning is not None
    rolls_mps2, step = coasting_mps2(29.0, PAPER_CAR), car.platooning.step

    def capped(*given: Any) -> PlatoonStep:
        return step(*given, cap_mps=car.speed_mps - rolls_mps2 * interval_s)

    car.platooning.step = capped  # type: ignore[method-assign]
    begin_mps = car.speed_mps
    world.run(5.0)
    assert begin_mps - car.speed_mps == pytest.approx(5.0 * rolls_mps2, rel=0.2)


def test_a_leader_that_is_held_back_announces_how_it_moves() -> None:
    """Its vehicle keeps a gap that its agent does not know of: followers must not count on more."""
    world = pair(0.5, delayed=False)
    car = world.car("v0")
    for _ in range(6):
        world.step()
        car.speed_mps, car.acceleration_mps2 = 26.0, 0.0
    world.step()
    assert car.last is not None
    assert car.last.lead_mps > 26.5
    assert car.last.control.announced_mps == pytest.approx(26.0)


@pytest.mark.slow
@pytest.mark.parametrize(("interval_s", "delayed"), MODES)
def test_a_platoon_is_apart_where_the_gate_is_closed(interval_s: float, delayed: bool) -> None:
    """It opens its gap before, by coasting, and closes it again behind."""
    world = World(string(2, None, 20.0, 28.0), interval_s, delayed, gates=Roadside({"d"}))
    assert world.run(60.0, lambda: is_close(world))
    begin = world.steps
    assert world.run(120.0, lambda: world.car("v1").place_m >= 3000.0)
    assert world.gap_m("v1") > 15.0
    assert hardest(world.speeds["v1"][begin:], interval_s) < 0.5
    step = world.car("v1").last
    assert step is not None
    assert step.mode != "following"
    assert world.run(150.0, lambda: is_close(world))
    assert world.car("v1").place_m > 4000.0


@pytest.mark.parametrize(("interval_s", "delayed"), MODES)
def test_a_gate_that_closes_under_a_platoon_parts_it(interval_s: float, delayed: bool) -> None:
    """From the next step on, told to the partner, with the reason."""
    world = pair(interval_s, delayed=delayed)
    here = world.car("v1").state().segment
    world.gates.closed.add(here)
    world.step()
    step = world.car("v1").last
    assert step is not None
    assert step.mode == "leaving"
    assert step.reason == f"the gate of {here} is not open"
    assert [(m.kind, m.partner) for m in step.messages] == [("leave", "v0")]
    world.run(20.0)
    assert world.gap_m("v1") > 12.0


def test_turbulent_traffic_parts_a_platoon_until_it_has_left_the_segment() -> None:
    """Also where it is the front vehicle's segment, and although it is calm again soon."""
    world = pair()
    number = world.car("v1").state().number
    end_m = world.car("v1").leg.ends_m[number]
    world.run(60.0, lambda: world.car("v0").place_m > end_m)
    assert world.car("v1").place_m < end_m
    rough = world.car("v0").state().segment
    world.gates.turbulent.add(rough)
    world.run(0.2)  # the front one's message comes one interval late
    step = world.car("v1").last
    assert step is not None
    assert (step.mode, step.reason) == ("leaving", f"the traffic on {rough} is turbulent")
    world.gates.turbulent.clear()
    left_m = world.car("v1").leg.ends_m[number + 1]
    begin = len(world.modes["v1"])
    assert world.run(60.0, lambda: world.car("v1").place_m > left_m)
    assert "following" not in world.modes["v1"][begin:-1]
    assert world.run(120.0, lambda: is_close(world))


def test_a_partner_silent_for_half_a_second_is_left() -> None:
    """Not before 0.5 s after its last message, and at once then; the gap opens."""
    world = pair()
    world.car("v0").silent = True
    silent_from = world.steps
    assert world.run(2.0, lambda: world.modes["v1"][-1] == "leaving")
    seconds = (world.steps - silent_from) * world.interval_s
    assert 0.4 < seconds <= 0.7
    step = world.car("v1").last
    assert step is not None
    assert step.reason == "v0 is silent"
    gap_m = world.gap_m("v1")
    world.run(1.0)
    assert world.gap_m("v1") > gap_m
    assert world.run(60.0, lambda: world.modes["v1"][-1] == "alone")
    assert world.gap_m("v1") > 15.0
    world.car("v0").silent = False
    assert world.run(120.0, lambda: is_close(world))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_with_three_messages_in_ten_lost_a_platoon_forms_and_keeps(seed: int) -> None:
    """Five in a row lose it, about once a minute; nobody comes too near nor brakes hard for it."""
    world = World(string(3, None, 40.0, 28.0), 0.1, delayed=True, loss=0.3, seed=seed)
    world.run(240.0)
    for name in ("v1", "v2"):
        modes = world.modes[name]
        assert modes.count("following") > 0.6 * len(modes)
        assert min(world.gaps[name]) > 1.3
        assert hardest(world.speeds[name], 0.1) < 3.5


@pytest.mark.parametrize("late_s", [0.05, 0.15, 0.3, 0.45])
@pytest.mark.parametrize("speed_mps", [15.0, 30.0])
def test_late_sensing_alone_is_no_emergency(speed_mps: float, late_s: float) -> None:
    """In a steady platoon a follower brakes comfortably at most, and leaves after 0.3 s."""
    leg = road("abcdefghij", 2000.0, 30.0, platoon="p", place=1)
    world = World(string(2, lambda _: speed_mps, 1.5 + 0.1 * speed_mps, speed_mps, leg))
    world.run(5.0)
    car = world.car("v1")
    sensing = world.sensing(car, world.car("v0"))
    now_ns = world.now_ns + round(late_s * 1e9)
    assert car.platooning is not None
    step = car.platooning.step(now_ns, leg, car.state(), sensing, world.gates)
    assert step.speed_mps is not None
    assert step.speed_mps - car.speed_mps >= -0.2501
    assert step.mode == ("following" if late_s <= 0.3 else "leaving")
    if step.mode == "following":
        aged = replace(IDEAL, sensing_s=late_s)
        wanted_m = least_gap_m(speed_mps, 9.0, aged)
        assert step.gap_m == pytest.approx(wanted_m, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("unsensed", [0.01, 0.1])
def test_lost_samples_of_the_own_sensing_do_not_part_a_platoon(unsensed: float) -> None:
    """One in a hundred, and one in ten: nobody brakes harder than comfortably."""
    world = World(string(3, lambda _: 28.0, 4.3, 28.0), unsensed=unsensed)
    world.run(120.0)
    for name in ("v1", "v2"):
        assert world.modes[name].count("following") > 0.9 * len(world.modes[name])
        assert min(world.gaps[name]) > 3.0
        assert hardest(world.speeds[name], 0.1) <= 2.6


@pytest.mark.parametrize("latency", [1, 2])
def test_sensing_that_is_always_late_keeps_a_wider_gap(latency: int) -> None:
    """By the way in its age, 0.1 or 0.2 s."""
    world = World(string(2, lambda _: 20.0, 10.0, 20.0), latency=latency)
    world.run(60.0)
    assert world.modes["v1"][-1] == "following"
    aged = replace(IDEAL, sensing_s=0.1 * latency)
    assert world.gap_m("v1") == pytest.approx(least_gap_m(20.0, 9.0, aged), abs=0.3)
    assert hardest(world.speeds["v1"][5:], 0.1) <= 2.6


@pytest.mark.parametrize("seed", range(2))
def test_who_misses_samples_still_brakes_as_hard_as_it_must(seed: int) -> None:
    """The leader brakes with 6 m/s² to a stand, one sample in ten is lost; nobody is touched."""
    world = World(
        string(3, lambda t: max(0.0, 25.0 - 6.0 * max(0.0, t - 10.0)), 4.0, 25.0),
        unsensed=0.1,
        seed=seed,
    )
    world.run(20.0)
    assert [car.speed_mps for car in world.cars] == pytest.approx([0.0, 0.0, 0.0], abs=0.15)
    assert min(min(world.gaps[name]) for name in ("v1", "v2")) > 0.0


@pytest.mark.parametrize(("interval_s", "delayed"), MODES)
def test_whoever_cuts_in_is_given_room(interval_s: float, delayed: bool) -> None:
    """A vehicle that is not of the fleet comes between: the follower leaves at once."""
    world = pair(interval_s, delayed=delayed, gap_m=20.0)
    front, rear = world.cars
    place_m = (front.place_m - LENGTH_M + rear.place_m) / 2 + LENGTH_M / 2
    front.place_m += 6.0
    other = Car(
        "other",
        place_m + 3.0,
        rear.speed_mps,
        rear.leg,
        script=lambda _: LIMIT - 1.0,
        fleet=False,
    )
    world.cars.insert(1, other)
    world.step()
    step = rear.last
    assert step is not None
    assert step.mode == "leaving"
    assert step.reason == "the vehicle ahead is not of the fleet"
    world.run(40.0)
    assert min(world.gaps["v1"]) > 0.5
    assert world.gap_m("v1") > 20.0


def test_a_plan_that_is_superseded_opens_the_gap_at_once() -> None:
    """The follower's as the leader's: the partner is told and opens it too."""
    world = pair()
    rear, front = world.car("v1"), world.car("v0")
    assert rear.platooning is not None
    assert front.platooning is not None
    told = rear.platooning.reset("a new plan")
    assert [(m.kind, m.partner, m.reason) for m in told] == [("leave", "v0", "a new plan")]
    world.step()
    assert rear.last is not None
    assert (rear.last.mode, rear.last.reason) == ("leaving", "a new plan")

    world = pair()
    rear, front = world.car("v1"), world.car("v0")
    assert rear.platooning is not None
    assert front.platooning is not None
    for message in front.platooning.reset("a new plan"):
        rear.platooning.receive(message, world.now_ns)
    world.step()
    assert rear.last is not None
    assert (rear.last.mode, rear.last.reason) == ("leaving", "v0 has left")


def test_a_reason_that_lasts_keeps_a_vehicle_alone_once_its_gap_is_open() -> None:
    """Told in every interval to end platooning, it opens its gap, drives alone and joins nobody."""
    world = pair()
    rear = world.car("v1")
    assert rear.platooning is not None
    begin = len(world.modes["v1"])
    for _ in range(600):
        rear.platooning.reset("the clock is in doubt")
        world.step()
    modes = world.modes["v1"][begin:]
    assert "following" not in modes
    assert modes[-1] == "alone"
    assert rear.last is not None
    assert rear.last.partner is None


def test_a_sensor_that_loses_the_front_vehicle_for_a_moment_parts_nobody() -> None:
    """For less than a second the follower drives no faster than that one tells; then it leaves."""
    world = pair()
    front = world.cars.pop(0)
    speed = world.car("v1").speed_mps
    for _ in range(8):
        front.place_m += front.speed_mps * world.interval_s
        world._waiting.append(_told(world, front))
        world.step()
        assert world.modes["v1"][-1] == "following"
        assert world.speeds["v1"][-1] <= speed + 1e-9
    for _ in range(3):
        world._waiting.append(_told(world, front))
        world.step()
    assert world.modes["v1"][-1] == "leaving"


def _told(world: World, car: Car) -> PlatoonControl:
    car.sequence += 1
    assert car.last is not None
    message = car.last.control
    return message.model_copy(
        update={"time_ns": world.now_ns, "sequence": message.sequence + car.sequence}
    )


def test_those_who_drive_one_path_for_a_moment_only_stay_apart() -> None:
    """Neither is asked for anything, nor is there a command."""
    world = World(string(2, None, 100.0, 28.0), gates=Roadside(set("abcdefghij")))
    for _ in range(100):
        world.step()
        for car in world.cars:
            assert car.last is not None
            assert car.last.speed_mps is car.last.cruise_mps is None
            assert not car.last.messages


def plan_leg(place: int) -> Leg:
    """Town streets on which the plan has a platoon."""
    names = "abcdefgh"
    return Leg(1, 0, tuple(planned(n, 400.0, 13.9, "p", place, 1) for n in names))


def test_a_planned_platoon_a_little_apart_forms() -> None:
    """Three members 2.5 s apart in town: each looks for the one ahead of it in the plan."""
    cars = [Car(f"v{i}", 200.0 - 35.0 * i, 13.0, plan_leg(i)) for i in range(3)]
    world = World(cars, 0.5, delayed=False)
    assert world.run(120.0, lambda: is_close(world, "v1") and is_close(world, "v2"))
    assert world.car("v2").place_m < 1600.0
    assert max(max(speeds) for speeds in world.speeds.values()) <= 13.9 + 1e-9


def test_the_same_road_twice_is_the_same_drive() -> None:
    """To the last bit."""
    one, other = (World(string(3, None, 60.0, 28.0), 0.5, delayed=False) for _ in range(2))
    one.run(60.0)
    other.run(60.0)
    assert one.speeds == other.speeds
    assert one.modes == other.modes


@pytest.mark.slow
def test_a_leader_that_promised_less_than_a_signal_asks_for_parts_before_it() -> None:
    """Ordinary cars on wet roads promise 2 m/s²; a stop line may ask for 2.5, a yellow is short."""
    crossing = PlannedCrossing(
        length_m=10.0, speed_mps=20.0, yields=False, intersection="x", signal_groups=((0, 1),)
    )
    parts = [planned(name, 1500.0, 20.0) for name in "abc"]
    parts[0] = parts[0].model_copy(update={"crossing": crossing})
    leg, wet = Leg(1, 0, tuple(parts)), BRAKING["car"].on("wet")
    world = World(string(3, None, 25.0, 19.0, leg))
    for car in world.cars:
        car.platooning = platooning_of(0.1, name=car.name, braking=wet)
    assert world.run(60.0, lambda: promised(world) is not None)
    limit = promised(world)
    assert limit is not None
    assert limit < 2.5
    assert world.run(120.0, lambda: promised(world) is None)
    away_m = leg.ends_m[0] - world.car("v0").place_m
    assert away_m == pytest.approx(20.0 * world.car("v0").speed_mps, rel=0.05)
    assert world.run(60.0, lambda: world.car("v0").place_m > leg.ends_m[0] + 20.0)
    assert promised(world) is not None or world.run(60.0, lambda: promised(world) is not None)


def promised(world: World) -> float | None:
    """What the first vehicle promises now."""
    step = world.car("v0").last
    return None if step is None else step.control.limit_mps2


@pytest.mark.slow
def test_a_platoon_is_no_longer_than_its_brakes_cover() -> None:
    """Ideal vehicles with gaps of 2 m: eight. The ninth drives alone."""
    world = World(string(9, None, 20.0, 28.0), 0.1, delayed=True)
    world.run(100.0)
    modes = [set(world.modes[f"v{n}"][-100:]) for n in range(1, 9)]
    assert modes == [*[{"following"}] * 7, {"alone"}]
    assert min(world.gaps["v8"][-100:]) > CLOSE_GAP_M


@pytest.mark.slow
def test_one_whose_brakes_cover_less_promises_nothing_to_another() -> None:
    """A truck on a wet road between two vehicles whose own brakes cover three."""
    world = World(string(3, None, 20.0, 28.0), 0.1, delayed=True)
    for name, kind, state in (("v1", "truck", "wet"), ("v2", "car", "dry")):
        braking = BRAKING[kind].on(state)
        world.car(name).platooning = platooning_of(0.1, name=name, braking=braking)
    world.run(60.0)
    assert world.modes["v1"][-1] == "following"
    assert world.car("v1").last.control.limit_mps2 is None
    assert min(world.gaps["v2"]) > CLOSE_GAP_M
