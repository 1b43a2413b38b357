"""What is believed of what others tell, and who waits for whom."""

from collections.abc import Callable

import pytest

from slipstream.energy.drafting import DragLaw
from slipstream.messages import PlatoonControl, PlatoonManagement, SensedVehicle
from tests.vehicle_agent.platooning.world import (
    BEGIN_NS,
    Roadside,
    planned,
    platooning_of,
    road,
    sensing_of,
    told,
)
from vehicle_agent.leg import Leg, VehicleState
from vehicle_agent.platooning import Platooning, PlatoonStep
from vehicle_agent.platooning.neighbours import MAX_NEIGHBOURS, Neighbours

NS = 1_000_000_000
LEG = Leg(1, 0, tuple(planned(name, 3000.0, 30.0) for name in "abc"))


def heard(neighbours: Neighbours, now_ns: int = BEGIN_NS) -> int | None:
    """Sequence of the partner's message that is believed."""
    fresh = neighbours.fresh("p", now_ns)
    return None if fresh is None else fresh[0].sequence


def at(time_ns: int, sequence: int, **update: object) -> PlatoonControl:
    """A message of the partner."""
    return told(time_ns, sequence, 300.0, 25.0, 25.0).model_copy(update=update)


def test_a_partner_is_silent_after_half_a_second_by_either_clock() -> None:
    """By when the message came, and by when it says that it was sent."""
    neighbours = Neighbours("me", 0.1)
    neighbours.receive(at(BEGIN_NS, 1), BEGIN_NS)
    assert heard(neighbours, BEGIN_NS + NS // 2) == 1
    assert heard(neighbours, BEGIN_NS + NS // 2 + 1) is None
    late = Neighbours("me", 0.1)
    late.receive(at(BEGIN_NS - 4 * NS // 10, 1), BEGIN_NS)
    assert heard(late, BEGIN_NS + NS // 10) == 1
    assert heard(late, BEGIN_NS + NS // 10 + 1) is None


@pytest.mark.parametrize(
    "message",
    [
        pytest.param(at(BEGIN_NS + NS // 10 + 1, 2), id="of the future"),
        pytest.param(at(BEGIN_NS - NS, 2), id="old"),
        pytest.param(at(BEGIN_NS, 1), id="again"),
        pytest.param(at(BEGIN_NS, 0), id="sequence runs back"),
        pytest.param(at(BEGIN_NS - NS // 10, 2), id="time runs back"),
        pytest.param(at(BEGIN_NS, 2, vehicle="me"), id="of oneself"),
    ],
)
def test_what_is_not_believed(message: PlatoonControl) -> None:
    """It is ignored, and what was known before stays."""
    neighbours = Neighbours("me", 0.1)
    neighbours.receive(at(BEGIN_NS - NS // 20, 1), BEGIN_NS)
    neighbours.receive(message, BEGIN_NS)
    assert heard(neighbours) == 1
    assert neighbours.fresh("me", BEGIN_NS) is None


def test_a_vehicle_that_starts_anew_is_heard_after_its_silence() -> None:
    """Its sequence begins at 0 again; a clock that was set back forgets everybody."""
    neighbours = Neighbours("me", 0.1)
    neighbours.receive(at(BEGIN_NS, 9), BEGIN_NS)
    later_ns = BEGIN_NS + NS
    neighbours.forget(later_ns)
    neighbours.receive(at(later_ns, 0), later_ns)
    assert heard(neighbours, later_ns) == 0
    assert heard(neighbours, BEGIN_NS) is None
    neighbours.forget(BEGIN_NS)
    assert len(neighbours) == 0


def test_no_more_vehicles_are_remembered_than_may_be() -> None:
    """Those that are known go on being heard."""
    neighbours = Neighbours("me", 0.1)
    for number in range(MAX_NEIGHBOURS + 50):
        neighbours.receive(at(BEGIN_NS, 1, vehicle=f"v{number}"), BEGIN_NS)
    assert len(neighbours) == MAX_NEIGHBOURS
    neighbours.receive(at(BEGIN_NS, 2, vehicle="v0"), BEGIN_NS)
    fresh = neighbours.fresh("v0", BEGIN_NS)
    assert fresh is not None
    assert fresh[0].sequence == 2


class Front:
    """A vehicle alone on a motorway that others ask."""

    def __init__(self) -> None:
        self.platooning = platooning_of(0.1)
        self.now_ns = BEGIN_NS
        self.sequence = 0
        self.place_m = 500.0
        self.behind: SensedVehicle | None = None

    def hears(self, vehicle: str, place_m: float, **update: object) -> None:
        """Another vehicle tells where it is."""
        self.sequence += 1
        message = told(self.now_ns, self.sequence, place_m, 30.0, 30.0)
        update = {"vehicle": vehicle, "leader": vehicle} | update
        self.platooning.receive(message.model_copy(update=update), self.now_ns)

    def asked(
        self, by: str, slowdown: float = 0.1, kind: str = "join_request", at_ns: int | None = None
    ) -> None:
        """Another vehicle sends it a message."""
        self.sequence += 1
        message = PlatoonManagement(
            vehicle=by,
            partner="me",
            sequence=self.sequence,
            time_ns=self.now_ns if at_ns is None else at_ns,
            kind=kind,  # type: ignore[arg-type]
            accepted=None,
            slowdown=slowdown,
        )
        self.platooning.receive(message, self.now_ns)

    def step(self, seconds: float = 0.0) -> PlatoonStep:
        """One interval, some time later."""
        self.now_ns += round(seconds * NS)
        state = VehicleState("a", 0, False, 0, self.place_m, 30.0)
        sensing = sensing_of(state, None, self.now_ns).model_copy(update={"behind": self.behind})
        return self.platooning.step(self.now_ns, LEG, state, sensing, Roadside())

    def answers(self, step: PlatoonStep) -> list[tuple[str, bool | None]]:
        """To whom, and whether it agrees."""
        return [(m.partner, m.accepted) for m in step.messages if m.kind == "join_response"]


def test_one_vehicle_is_waited_for_at_a_time() -> None:
    """The first that asks; another one when that one leaves."""
    front = Front()
    front.hears("r1", 300.0)
    front.hears("r2", 200.0)
    front.asked("r1")
    front.asked("r2")
    step = front.step()
    assert front.answers(step) == [("r1", True), ("r2", False)]
    assert step.messages[1].reason == "r1 joins it"
    assert step.control.joined_by == step.partner == "r1"
    assert step.cruise_mps is not None
    front.asked("r2", kind="leave")
    assert front.step().control.joined_by == "r1"
    front.asked("r1", kind="leave")
    step = front.step()
    assert (step.control.joined_by, step.cruise_mps) == (None, None)
    front.asked("r2")
    assert front.answers(front.step()) == [("r2", True)]


def test_nobody_waits_who_was_not_asked_for_five_seconds() -> None:
    """Renewed, it goes on; the set speed sinks to what was asked, 15 % at most."""
    front = Front()
    for number in range(300):
        if number % 10 == 0:
            front.hears("r1", 300.0)
            front.asked("r1", slowdown=0.9)
        step = front.step(0.1)
    assert step.cruise_mps == pytest.approx(25.5, abs=0.1)
    assert front.step(4.0).cruise_mps is not None
    step = front.step(0.2)
    assert (step.cruise_mps, step.control.joined_by) == (None, None)


def test_a_clock_that_is_set_back_ends_waiting() -> None:
    """The end of the agreement would lie far ahead."""
    front = Front()
    front.hears("r1", 300.0)
    front.asked("r1")
    assert front.step().control.joined_by == "r1"
    assert front.step(-600.0).control.joined_by is None


@pytest.mark.parametrize(
    ("told_place", "reason"),
    [
        pytest.param(None, "r was not heard", id="never heard"),
        pytest.param({"front_m": 700.0}, "r is not behind on the same road", id="ahead"),
        pytest.param(
            {"front_m": 10.0, "path": ("b", "c")},
            "r is not behind on the same road",
            id="far ahead",
        ),
        pytest.param(
            {"front_m": 10.0, "path": ("x", "y")},
            "r is not behind on the same road",
            id="elsewhere",
        ),
        pytest.param({"front_m": 10.0, "path": ("x", "a")}, None, id="from a side road"),
        pytest.param({"front_m": 470.0}, None, id="behind"),
    ],
)
def test_who_is_not_heard_behind_on_its_road_is_not_waited_for(
    told_place: dict[str, object] | None, reason: str | None
) -> None:
    """Whatever name it asks by; the answer says why."""
    front = Front()
    if told_place is not None:
        front.hears("r", 0.0, **told_place)
    front.asked("r")
    step = front.step()
    assert front.answers(step) == [("r", reason is None)]
    assert (step.messages[0].reason, step.cruise_mps is None) == (reason, reason is not None)


def waited_s(front: Front, seconds: float, tells: Callable[[int], None]) -> float:
    """For how long it drives more slowly for others, who tell something each second."""
    waited = 0.0
    for number in range(round(seconds * 10)):
        if number % 5 == 0:
            tells(number)
        waited += 0.1 * (front.step(0.1).cruise_mps is not None)
    return waited


@pytest.mark.long
def test_nobody_is_slowed_down_for_more_than_300_s_in_an_hour() -> None:
    """By another name each ten seconds, from where a vehicle may come, in 50 min; then anew."""
    front = Front()

    def asks(number: int) -> None:
        name = f"r{number // 100}"
        front.hears(name, 300.0)
        front.asked(name, slowdown=1.0)

    assert 280.0 < waited_s(front, 3000.0, asks) <= 301.0
    asks(30000)
    (answer,) = front.step(0.1).messages
    assert (answer.accepted, answer.reason) == (False, "it has waited for others for long")
    front.step(601.0)
    assert waited_s(front, 60.0, asks) > 50.0


FOLLOWS = {"mode": "following", "ahead": "me", "leader": "me", "gap_m": 60.0}


@pytest.mark.parametrize(
    ("tells", "behind", "believed"),
    [
        pytest.param({}, None, True, id="follower"),
        pytest.param(
            {}, SensedVehicle(track="t", vehicle="f", gap_m=63.0, speed_mps=30.0), True, id="sensed"
        ),
        pytest.param({"gap_m": 1e9}, None, False, id="gap that nobody follows at"),
        pytest.param({"front_m": 900.0}, None, False, id="ahead"),
        pytest.param({"path": ("x", "y")}, None, False, id="on another road"),
        pytest.param({"ahead": "g"}, None, False, id="behind nobody"),
        pytest.param(
            {},
            SensedVehicle(track="t", vehicle="f", gap_m=8.0, speed_mps=30.0),
            False,
            id="sensed elsewhere",
        ),
        pytest.param(
            {},
            SensedVehicle(track="t", vehicle="g", gap_m=60.0, speed_mps=30.0),
            False,
            id="another one sensed",
        ),
    ],
)
def test_a_leader_waits_for_followers_only_where_they_can_be(
    tells: dict[str, object], behind: SensedVehicle | None, believed: bool
) -> None:
    """Their gap, place and the chain to the leader agree with each other and its own sensing."""
    front = Front()
    front.behind = behind
    front.hears("f", 435.0, **(FOLLOWS | tells))
    assert (front.step().cruise_mps is not None) == believed


@pytest.mark.long
def test_followers_that_never_close_up_are_waited_for_no_longer_than_askers() -> None:
    """A made-up one that tells all that can be told; both count to the same 300 s."""
    front = Front()

    def asks(_number: int) -> None:
        front.hears("r", 300.0)
        front.asked("r", slowdown=1.0)

    assert waited_s(front, 200.0, asks) > 180.0
    rest = waited_s(front, 600.0, lambda _number: front.hears("f", 435.0, **FOLLOWS))
    assert 80.0 < rest <= 121.0


@pytest.mark.slow
def test_a_wait_that_another_vehicle_has_ended_by_coming_does_not_count() -> None:
    """The own sensing must have it close behind; the same vehicle ends no second one."""
    front = Front()

    def asks(_number: int) -> None:
        front.hears("r", 300.0)
        front.asked("r", slowdown=0.05)

    def comes(vehicle: str, gap_m: float | None) -> None:
        close = SensedVehicle(track="t", vehicle=vehicle, gap_m=gap_m or 0.0, speed_mps=30.0)
        front.behind = None if gap_m is None else close
        front.hears(vehicle, 490.0, **(FOLLOWS | {"gap_m": 4.5}))
        front.step(0.1)
        front.behind = None
        front.asked(vehicle, kind="leave")
        front.hears(vehicle, 490.0, mode="alone", ahead=None, leader=vehicle)

    waited_s(front, 250.0, asks)
    comes("f", None)
    assert waited_s(front, 100.0, asks) < 51.0
    comes("f", 4.5)
    assert waited_s(front, 250.0, asks) > 200.0
    comes("f", 4.5)
    assert waited_s(front, 100.0, asks) < 51.0
    comes("g", 4.5)
    assert waited_s(front, 100.0, asks) > 90.0


def test_who_tells_another_place_than_it_is_sensed_at_is_not_followed_closely() -> None:
    """Ten metres are what both may know their places by; a follower leaves."""
    for shift_m, mode in ((9.0, "following"), (11.0, "alone"), (-11.0, "alone")):
        platooning = platooning_of(0.1)
        state = VehicleState("a", 0, False, 0, 500.0, 25.0)
        ahead = SensedVehicle(track="t", vehicle="p", gap_m=12.0, speed_mps=25.0)
        sensing = sensing_of(state, ahead, BEGIN_NS)
        platooning.receive(told(BEGIN_NS, 1, 516.6 + shift_m, 25.0, 25.0), BEGIN_NS)
        step = platooning.step(BEGIN_NS, LEG, state, sensing, Roadside())
        assert step.mode == mode
        if mode == "alone":
            assert step.reason == "p tells another place than it is sensed at"
            continue
        later_ns = BEGIN_NS + NS // 10
        platooning.receive(told(later_ns, 2, 516.6 + 30.0, 25.0, 25.0), later_ns)
        sensing = sensing_of(state, ahead, later_ns)
        assert platooning.step(later_ns, LEG, state, sensing, Roadside()).mode == "leaving"


def test_requests_late_of_the_future_or_again_are_ignored() -> None:
    """Neither answered nor followed."""
    front = Front()
    front.asked("r1", at_ns=front.now_ns - 2 * NS)
    front.asked("r1", at_ns=front.now_ns + NS)
    assert front.step().messages == ()
    front.asked("r1")
    front.sequence -= 1
    front.asked("r1")
    assert len(front.step().messages) == 1


def test_whoever_joins_beside_changes_to_that_lane() -> None:
    """On a motorway of two lanes: 20 m apart it drops back, farther behind it changes lanes."""
    leg = road("abcdefgh", 3000.0, 30.0, lanes=2)
    for front_m, wanted, drops in ((520.0, None, True), (560.0, 1, False)):
        platooning = platooning_of(0.1)
        message = told(BEGIN_NS, 1, front_m, 30.0, 30.0)
        beside = message.model_copy(update={"lane": 1, "path": leg.path})
        platooning.receive(beside, BEGIN_NS)
        state = VehicleState("a", 0, False, 0, 500.0, 30.0)
        sensing = sensing_of(state, None, BEGIN_NS)
        step = platooning.step(BEGIN_NS, leg, state, sensing, Roadside())
        assert step.partner == "p"
        assert step.lane == wanted
        assert (step.cruise_mps is not None) == drops
        assert [(m.kind, m.partner) for m in step.messages] == [("join_request", "p")]


def test_whoever_is_behind_another_vehicle_asks_nobody() -> None:
    """On a road where it cannot pass."""
    leg = road("abcdefgh", 3000.0, 20.0)
    platooning = platooning_of(0.1)
    message = told(BEGIN_NS, 1, 600.0, 20.0, 20.0).model_copy(update={"path": leg.path})
    state = VehicleState("a", 0, False, 0, 500.0, 20.0)
    between = SensedVehicle(track="x", vehicle=None, gap_m=40.0, speed_mps=20.0)
    platooning.receive(message, BEGIN_NS)
    sensing = sensing_of(state, between, BEGIN_NS)
    assert platooning.step(BEGIN_NS, leg, state, sensing, Roadside()).messages == ()


def test_who_saves_more_by_its_law_asks_for_less_way() -> None:
    """On two segments of 330 m a van by its measured law, on two of 400 m by the paper's too."""

    def asks(length_m: float, law: DragLaw) -> bool:
        leg = road("ab", length_m, 20.0)
        platooning = platooning_of(0.1, law)
        message = told(BEGIN_NS, 1, 260.0, 20.0, 20.0).model_copy(update={"path": leg.path})
        platooning.receive(message, BEGIN_NS)
        state = VehicleState("a", 0, False, 0, 200.0, 20.0)
        sensing = sensing_of(state, None, BEGIN_NS)
        return platooning.step(BEGIN_NS, leg, state, sensing, Roadside()).messages != ()

    assert (asks(330.0, "van"), asks(330.0, "paper")) == (True, False)
    assert (asks(400.0, "van"), asks(400.0, "paper")) == (True, True)


def test_a_vehicle_that_follows_sends_askers_away() -> None:
    """Its leader is in its messages."""
    platooning = platooning_of(0.1)
    platooning.receive(told(BEGIN_NS, 1, 504.6 + 4.5, 25.0, 25.0), BEGIN_NS)
    state = VehicleState("a", 0, False, 0, 500.0, 25.0)
    ahead = SensedVehicle(track="t", vehicle="p", gap_m=4.5, speed_mps=25.0)
    sensing = sensing_of(state, ahead, BEGIN_NS)
    step = platooning.step(BEGIN_NS, LEG, state, sensing, Roadside())
    assert (step.mode, step.control.leader, step.control.gap_m) == ("following", "p", 4.5)
    request = PlatoonManagement(
        vehicle="r",
        partner="me",
        sequence=0,
        time_ns=BEGIN_NS,
        kind="join_request",
        accepted=None,
        slowdown=0.1,
    )
    platooning.receive(request, BEGIN_NS)
    step = platooning.step(BEGIN_NS, LEG, state, sensing, Roadside())
    answer = next(m for m in step.messages if m.kind == "join_response")
    assert (answer.partner, answer.accepted, answer.reason) == ("r", False, "it is following")


def test_it_listens_two_kilometres_ahead_and_behind() -> None:
    """Segments of its path, from the ends of its own one, on which the topics stay."""
    leg = road("abcdefghij", 800.0)
    state = VehicleState("d", 3, False, 0, 100.0, 20.0)
    assert Platooning.segments_of_interest(leg, state) == tuple("abcdefg")
    last = VehicleState("j", 9, False, 0, 100.0, 20.0)
    assert Platooning.segments_of_interest(leg, last) == tuple("ghij")
    first = VehicleState("a", 0, False, 0, 0.0, 0.0)
    assert Platooning.segments_of_interest(leg, first) == tuple("abcd")


@pytest.mark.parametrize("length_m", [100.0, 2800.0, 12000.0])
def test_who_is_just_beyond_the_end_of_its_segment_is_heard_from_its_begin_on(
    length_m: float,
) -> None:
    """Topics change with the segment only, and a platoon crosses every end of one."""
    leg = road("abc", length_m)
    for front_m in (0.0, length_m - 1.0):
        state = VehicleState("a", 0, False, 0, front_m, 30.0)
        assert "b" in Platooning.segments_of_interest(leg, state)


def test_whoever_was_told_to_end_platooning_joins_nobody_for_two_seconds() -> None:
    """Also if it drove alone then."""
    platooning = platooning_of(0.1)
    state = VehicleState("a", 0, False, 0, 500.0, 25.0)
    ahead = SensedVehicle(track="t", vehicle="p", gap_m=4.5, speed_mps=25.0)
    now_ns, modes = BEGIN_NS, []
    platooning.step(now_ns, LEG, state, sensing_of(state, None, now_ns), Roadside())
    platooning.reset("a new plan")
    for number in range(40):
        now_ns += NS // 10
        if number >= 5:
            platooning.receive(told(now_ns, number, 504.6 + 4.5, 25.0, 25.0), now_ns)
        seen = ahead if number >= 5 else None
        step = platooning.step(now_ns, LEG, state, sensing_of(state, seen, now_ns), Roadside())
        modes.append(step.mode)
    assert "following" not in modes[:19]
    assert modes[-1] == "following"


def test_nobody_drops_back_for_a_vehicle_that_refuses_or_is_gone() -> None:
    """Its lane and set speed are its own again at once."""
    leg = road("abcdefgh", 3000.0, 30.0, lanes=2)
    platooning = platooning_of(0.1)
    beside = told(BEGIN_NS, 1, 520.0, 30.0, 30.0).model_copy(update={"lane": 1, "path": leg.path})
    platooning.receive(beside, BEGIN_NS)
    state = VehicleState("a", 0, False, 0, 500.0, 30.0)
    sensing = sensing_of(state, None, BEGIN_NS)
    assert platooning.step(BEGIN_NS, leg, state, sensing, Roadside()).cruise_mps is not None
    refusal = PlatoonManagement(
        vehicle="p",
        partner="me",
        sequence=0,
        time_ns=BEGIN_NS,
        kind="join_response",
        accepted=False,
    )
    platooning.receive(refusal, BEGIN_NS)
    step = platooning.step(BEGIN_NS, leg, state, sensing, Roadside())
    assert (step.cruise_mps, step.lane, step.partner) == (None, None, None)


def after_a_lane_change(lane: int) -> tuple[PlatoonStep, PlatoonStep]:
    """A follower whose partner is no longer sensed ahead and slows down: at once, 1.5 s later."""
    platooning = platooning_of(0.5)
    place_m, ahead = 500.0, SensedVehicle(track="t", vehicle="p", gap_m=4.5, speed_mps=30.0)
    steps = []
    for number in range(5):
        now_ns = BEGIN_NS + number * NS // 2
        speed = 30.0 if number < 2 else 28.0
        message = told(now_ns, number + 1, place_m + 9.1, 30.0, speed)
        platooning.receive(
            message.model_copy(update={"lane": 0 if number < 2 else lane, "announced_mps": speed}),
            now_ns,
        )
        state = VehicleState("a", 0, False, 0, place_m, 30.0)
        seen = ahead if number < 2 else None
        steps.append(
            platooning.step(now_ns, LEG, state, sensing_of(state, seen, now_ns), Roadside())
        )
        place_m += 15.0
    return steps[2], steps[4]


def test_a_partner_that_has_changed_its_lane_is_followed_without_braking() -> None:
    """It is not in the way; a sensor that merely loses it is another matter."""
    first, later = after_a_lane_change(lane=1)
    assert first.speed_mps is not None
    assert 29.7 < first.speed_mps < 30.0
    assert (first.mode, first.lane, later.mode) == ("following", 1, "following")
    first, later = after_a_lane_change(lane=0)
    assert (first.speed_mps, first.mode, later.mode) == (28.0, "following", "leaving")


def test_who_waits_for_another_vehicle_is_caught_up_with_and_not_asked() -> None:
    """Nor is anybody beyond it."""
    platooning = platooning_of(0.1)
    for name, place_m, by in (("p", 800.0, "r"), ("q", 1200.0, None)):
        message = told(BEGIN_NS, 1, place_m, 25.0, 25.0)
        update = {"vehicle": name, "leader": name, "joined_by": by}
        platooning.receive(message.model_copy(update=update), BEGIN_NS)
    state = VehicleState("a", 0, False, 0, 500.0, 25.0)
    step = platooning.step(BEGIN_NS, LEG, state, sensing_of(state, None, BEGIN_NS), Roadside())
    assert (step.partner, step.messages) == ("p", ())
