"""Whom a vehicle believes: what the one ahead tells against what it drives, and what one costs."""

import random
from collections import deque
from dataclasses import replace

import pytest

from slipstream.braking import BRAKING
from slipstream.energy.consumption import PAPER_CAR
from slipstream.messages import PlatoonManagement, SensedVehicle
from slipstream.spacing import LIMIT_RATIO, least_gap_m
from tests.vehicle_agent.platooning.world import (
    BEGIN_NS,
    IDEAL,
    Roadside,
    planned,
    platooning_of,
    sensing_of,
    told,
)
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning import AheadMotion, Own, PlatoonStep
from vehicle_agent.platooning.needed_braking import Told
from vehicle_agent.platooning.neighbours import MOST_COST_S, CausedDelays, Neighbours
from vehicle_agent.platooning.speed_commands import believed

NS = 1_000_000_000
LEG = Leg(1, 0, tuple(planned(name, 9000.0, 30.0) for name in "abc"))
SPEED_MPS = 25.0


def asks(vehicle: str, now_ns: int, sequence: int) -> PlatoonManagement:
    """To be waited for, with all of the speed."""
    return PlatoonManagement(
        vehicle=vehicle,
        partner="me",
        sequence=sequence,
        time_ns=now_ns,
        kind="join_request",
        accepted=None,
        slowdown=1.0,
    )


class Ahead:
    """A vehicle directly ahead with an even gap, that tells what it likes."""

    def __init__(self, gap_m: float = 12.0) -> None:
        self.platooning = platooning_of(0.1)
        self.steps = 0
        self.gap_m = gap_m
        self.ahead_mps = SPEED_MPS
        self.last: PlatoonStep | None = None

    def step(self, **tells: object) -> PlatoonStep:
        """One interval; both drive on as they are sensed."""
        now_ns = BEGIN_NS + self.steps * NS // 10
        place_m = 500.0 + 2.5 * self.steps
        message = told(now_ns, self.steps, place_m + self.gap_m + 4.6, self.ahead_mps, SPEED_MPS)
        self.platooning.receive(message.model_copy(update=tells), now_ns)
        state = VehicleState("a", 0, False, 0, place_m, SPEED_MPS)
        ahead = SensedVehicle(track="t", vehicle="p", gap_m=self.gap_m, speed_mps=self.ahead_mps)
        self.steps += 1
        sensing = sensing_of(state, ahead, now_ns)
        self.last = self.platooning.step(now_ns, LEG, state, sensing, Roadside())
        return self.last

    def until_distrust(self, seconds: float, **tells: object) -> str | None:
        """Why it is not believed any more, if it comes to that within a time."""
        for _ in range(round(10 * seconds)):
            found = self.step(**tells).distrusts
            if found is not None:
                return found
        return None


@pytest.mark.parametrize(
    "tells",
    [
        pytest.param({"planned_mps2": (-2.0,) * 4}, id="planned"),
        pytest.param({"acceleration_mps2": -2.0}, id="measured"),
        pytest.param({"planned_mps2": (-9.8,) * 8, "limit_mps2": 2.0}, id="hard, with a promise"),
    ],
)
def test_who_tells_braking_that_does_not_come_is_left_and_not_believed_for_an_hour(
    tells: dict[str, object],
) -> None:
    """Within two seconds; its partner is told why."""
    ahead = Ahead()
    assert ahead.until_distrust(4.0, limit_mps2=2.0) is None
    reason = "p told of braking that did not come"
    assert ahead.until_distrust(2.0, **tells) == reason
    assert ahead.last is not None
    assert ahead.last.mode == "leaving"
    assert [(m.partner, m.kind, m.reason) for m in ahead.last.messages] == [("p", "leave", reason)]
    for _ in range(100):
        assert ahead.step().mode != "following"
    assert ahead.last.reason == reason


def test_told_braking_beyond_a_promise_counts_as_far_as_it_is_sensed() -> None:
    """Before, it is answered without breaking the own promise: a lie reaches nobody behind."""
    ahead = Ahead(gap_m=2.0)
    ahead.platooning = platooning_of(0.1, braking=BRAKING["car"].on("dry"))
    assert ahead.until_distrust(4.0, limit_mps2=2.0) is None
    tells = {"planned_mps2": (-9.8,) * 8, "acceleration_mps2": -9.8, "limit_mps2": 2.0}
    lies = ahead.step(**tells).acceleration_mps2
    ahead.ahead_mps -= 1.0
    brakes = ahead.step(**tells).acceleration_mps2
    assert lies is not None
    assert brakes is not None
    assert -LIMIT_RATIO * 2.0 * 1.5 < lies < -2.0
    assert brakes < -6.0


def test_who_brakes_harder_than_it_promised_is_left() -> None:
    """By its sensed speed, whatever it tells; where it has told of it, it has not lied."""
    for tells, found in (((), "p braked harder than it promised"), ((-5.0,) * 8, None)):
        ahead = Ahead()
        assert ahead.until_distrust(4.0, limit_mps2=2.0) is None
        reasons = set()
        for _ in range(12):
            ahead.ahead_mps -= 0.5
            reasons.add(ahead.step(limit_mps2=2.0, planned_mps2=tells).distrusts)
        assert reasons - {None} == ({found} - {None})


@pytest.mark.parametrize("seed", range(24))
def test_who_drives_what_it_tells_is_believed(seed: int) -> None:
    """With any declared dead time, time constant, error and noise, a message in twenty lost."""
    rng = random.Random(seed)
    dead, lag = rng.randint(0, 3), rng.uniform(0.0, 0.3)
    share = rng.uniform(0.92, 1.08)
    pipeline = deque([0.0] * dead)
    found, speed, actual, command, heard = Told(), 25.0, 0.0, 0.0, (0.0, 0.0)
    for step in range(600):
        if step % rng.randint(5, 40) == 0:
            command = rng.choice((0.0, 1.0, -1.0, -2.5, -6.0)) if 5.0 < speed < 30.0 else 0.0
            command = 1.0 if speed < 5.0 else command
        if rng.random() >= 0.05:
            heard = command, actual
        pipeline.append(command)
        actual += (pipeline.popleft() * share - actual) * (min(1.0, 0.1 / lag) if lag else 1.0)
        sensed = speed + rng.gauss(0, 0.05)
        verdict = found.update(step * NS // 10, "t", sensed, *heard, 8.0)
        assert verdict is None, step
        speed += 0.1 * actual


def test_one_vehicle_may_cost_fifty_seconds_an_hour() -> None:
    """Each for itself; after an hour anew, by a clock that runs on."""
    costs = CausedDelays()
    assert not costs.add("a", MOST_COST_S, BEGIN_NS)
    assert not costs.add("b", 1.0, BEGIN_NS)
    assert costs.add("a", 0.1, BEGIN_NS + NS)
    assert not costs.add("a", 1.0, BEGIN_NS + 3600 * NS)


def test_who_is_not_believed_is_not_heard_for_an_hour() -> None:
    """What it told is forgotten at once."""
    neighbours = Neighbours("me", 0.1)
    neighbours.receive(told(BEGIN_NS, 1, 300.0, 25.0, 25.0), BEGIN_NS)
    neighbours.ignore("p", "why", BEGIN_NS)
    assert len(neighbours) == 0
    for later_ns, heard in ((3599 * NS, False), (3600 * NS, True)):
        now_ns = BEGIN_NS + later_ns
        neighbours.receive(told(now_ns, 2, 300.0, 25.0, 25.0), now_ns)
        assert (neighbours.fresh("p", now_ns) is not None) == heard
        assert (neighbours.doubt("p", now_ns) is None) == heard


@pytest.mark.long
@pytest.mark.slow
def test_who_asks_is_waited_for_no_longer_than_it_may_cost() -> None:
    """It comes and goes, asks for all that may be asked for, and comes with another one's help."""
    platooning, lost_s, sequence = platooning_of(0.1), 0.0, 0
    state = VehicleState("a", 0, False, 0, 5000.0, 30.0)
    for step in range(9000):
        now_ns = BEGIN_NS + step * NS // 10
        come = ("r", "q")[step // 2000 % 2] if step % 1000 < 5 else None
        for name in ("r", "q"):
            message = told(now_ns, step, 4990.0 if come else 4800.0, 30.0, 30.0)
            follows = {"mode": "following", "ahead": "me", "leader": "me", "gap_m": 5.4}
            update = {"vehicle": name, "leader": name, **(follows if name == come else {})}
            platooning.receive(message.model_copy(update=update), now_ns)
        if step % 10 == 0:
            sequence += 1
            platooning.receive(asks("r", now_ns, sequence), now_ns)
        sensing = sensing_of(state, None, now_ns)
        if come:
            close = SensedVehicle(track=come, vehicle=come, gap_m=5.4, speed_mps=30.0)
            sensing = sensing.model_copy(update={"behind": close})
        cruise = platooning.step(now_ns, LEG, state, sensing, Roadside()).cruise_mps
        lost_s += 0.0 if cruise is None else 0.1 * (1 - cruise / 30.0)
    assert 40.0 < lost_s <= MOST_COST_S + 0.1


def test_speeding_up_is_believed_only_as_far_as_the_gap_allows() -> None:
    """Not where the follower is as near as wanted and faster than the one ahead is sensed to be."""
    own = Own(25.5, 30.0, 30.0, 2.0, 0.1, PAPER_CAR, IDEAL)
    wanted_m = least_gap_m(25.0, 2.0, IDEAL) + 1.0
    for gap_m, own_mps, feed in ((wanted_m, 25.5, 0.0), (wanted_m, 25.1, 1.8), (9.0, 25.5, 1.8)):
        ahead = AheadMotion(gap_m, 25.0, feed_mps2=1.8, leader_mps=26.0)
        one = believed(replace(own, speed_mps=own_mps), ahead, wanted_m)
        assert one.feed_mps2 == feed
        assert one.leader_mps == (25.0 if feed == 0 else 26.0)
    nearer = believed(
        replace(own, speed_mps=25.0), AheadMotion(wanted_m - 0.3, 25.0, feed_mps2=0.2), wanted_m
    )
    assert nearer.feed_mps2 == 0.0
