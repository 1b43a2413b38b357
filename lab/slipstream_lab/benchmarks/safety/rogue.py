"""A rogue beside honest vehicles: it has a key of its own, tells what it likes, and drives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from slipstream.braking import BrakingClass, Road
from slipstream.energy.traction import PAPER_CAR
from slipstream.messages import PlatoonControl, PlatoonManagement
from slipstream.spacing import least_gap_m
from slipstream_lab.benchmarks.safety.stop import BEGIN_NS, Case, Run
from slipstream_lab.benchmarks.safety.vehicle import INTERVAL_S, LENGTH_M, STEP_S, Vehicle
from vehicle_agent.platooning import IDM, Own

Place = Literal["leader", "middle", "follower", "beside"]
"""leader, middle: of three. follower: of two, behind traffic. beside: on no lane of the two; what
it tells of its place is made up."""

GHOST: Final = "ghost"
"""Name of a rogue that is not on the road."""

ATTACKS_AT_S: Final = 15.0
_CRUISE_SHARE: Final = 0.9
"""Of the limit: speed of the traffic ahead."""

_TRAFFIC_M: Final = 45.0


@dataclass(frozen=True)
class Now:
    """A moment of an attack.

    Attributes:
        s: since its begin.
        v0: what the first honest vehicle told last.
        gap_m: to the vehicle ahead of the rogue.
    """

    s: float
    v0: PlatoonControl
    gap_m: float

    def every(self, period_s: float, for_s: float) -> bool:
        """Whether it is within the first part of a period."""
        return self.s % period_s < for_s


Tell = Callable[[Now, PlatoonControl], Mapping[str, Any] | None]
"""What it changes of its message; None: it is silent."""


@dataclass(frozen=True)
class Attack:
    """What a rogue does.

    Attributes:
        tell: see `Tell`.
        ask: what it sends to one vehicle, besides, twice a second: kind, slowdown.
        body: acceleration of its vehicle; None: as its agent and driver say.
        traffic: whether there is traffic ahead of all.
        told_only: whether its body drives as an honest one's.
    """

    place: Place
    tell: Tell = lambda _now, _control: {}
    ask: Callable[[Now], Mapping[str, Any] | None] = lambda _now: None
    body: Callable[[Now], float | None] = lambda _now: None
    traffic: bool = False
    told_only: bool = True


def _planned(mps2: Callable[[Now], float]) -> Tell:
    return lambda now, _: {"planned_mps2": (mps2(now),) * 4, "acceleration_mps2": 0.0}


def _moved(by_m: Callable[[Now], float]) -> Tell:
    return lambda now, control: {"front_m": max(0.0, control.front_m + by_m(now))}


def _beside(away_m: float, **told: Any) -> Tell:
    """It tells that it drives as far from the first honest vehicle, as fast."""

    def tell(now: Now, _control: PlatoonControl) -> Mapping[str, Any]:
        front_m = max(0.0, now.v0.front_m + away_m)
        same = {name: getattr(now.v0, name) for name in ("path", "speed_mps", "desired_mps")}
        return {**same, "front_m": front_m, "planned_mps2": (), "announced_mps": 0.0, **told}

    return tell


_FOLLOWS: Final = {"mode": "following", "ahead": "v0", "leader": "v0", "needs_mps2": 0.001}

HONEST: Final[Mapping[str, Attack]] = {
    "nothing, leading": Attack("leader"),
    "nothing, in the middle": Attack("middle"),
    "nothing, following": Attack("follower"),
}
"""What the attacks are held against."""

ATTACKS: Final[Mapping[str, Attack]] = {
    **HONEST,
    "braking told": Attack("leader", _planned(lambda _: -9.8)),
    "braking told, in the middle": Attack("middle", _planned(lambda _: -9.8)),
    "braking told for a moment": Attack(
        "leader", _planned(lambda now: -9.8 if now.every(10.0, 0.5) else 0.0)
    ),
    "soft braking told": Attack("leader", _planned(lambda _: -0.5)),
    "swinging plans": Attack("leader", _planned(lambda now: 2 * math.sin(now.s * math.tau / 4))),
    "fast swinging plans": Attack("leader", _planned(lambda now: 5 * math.sin(now.s * math.tau))),
    "slightly swinging plans": Attack(
        "leader", _planned(lambda now: 0.5 * math.sin(now.s * math.tau / 4))
    ),
    "braking measured": Attack(
        "leader", lambda _now, _c: {"planned_mps2": (), "acceleration_mps2": -9.8}
    ),
    "speeding up told": Attack("leader", _planned(lambda _: 3.0)),
    "speeding up told, in the middle": Attack("middle", _planned(lambda _: 3.0)),
    "a little speeding up told": Attack("leader", _planned(lambda _: 0.2)),
    "half the speed told": Attack(
        "leader",
        lambda _now, c: {"speed_mps": c.speed_mps / 2, "planned_mps2": (0.0,) * 4},
    ),
    "more speed told": Attack(
        "leader",
        lambda _now, c: {"speed_mps": c.speed_mps + 0.5, "planned_mps2": (0.0,) * 4},
    ),
    "promise given and withdrawn": Attack(
        "leader", lambda now, _c: {"limit_mps2": None if now.every(15.0, 4.8) else 2.0}
    ),
    "promise withdrawn until left": Attack(
        "leader", lambda now, _c: {"limit_mps2": None if now.every(40.0, 6.0) else 2.0}
    ),
    "promise broken": Attack(
        "leader",
        lambda _now, _c: {"limit_mps2": 2.0, "planned_mps2": (0.0,) * 4, "acceleration_mps2": 0.0},
        body=lambda now: -5.0 if now.every(30.0, 1.0) else None,
        told_only=False,
    ),
    "place off by 9 m": Attack("leader", _moved(lambda now: 9.0 if now.every(4.0, 2.0) else -9.0)),
    "place off by 20 m at times": Attack(
        "leader", _moved(lambda now: 20.0 if now.every(20.0, 0.3) else 0.0)
    ),
    "leaves at times": Attack(
        "leader",
        ask=lambda now: {"kind": "leave", "partner": "v1"} if now.every(20.0, 0.5) else None,
    ),
    "silent at times": Attack("leader", lambda now, _c: None if now.every(20.0, 0.8) else {}),
    "silent while it brakes": Attack(
        "leader",
        lambda now, _c: None if now.every(2.0, 0.4) else {"planned_mps2": (-2.0,) * 8},
    ),
    "clock ahead": Attack(
        "leader",
        lambda now, c: {
            "time_ns": c.time_ns + 90_000_000,
            "planned_mps2": (-2.0 if now.every(4.0, 2.0) else 2.0,) * 4,
        },
    ),
    "clock behind": Attack(
        "leader",
        lambda now, c: {
            "time_ns": c.time_ns - 450_000_000,
            "planned_mps2": (-2.0 if now.every(4.0, 2.0) else 2.0,) * 8,
        },
    ),
    "another lane told": Attack("leader", lambda now, _c: {"lane": int(now.every(4.0, 2.0))}),
    "needs the least": Attack("follower", lambda _now, _c: {"needs_mps2": 0.001}, traffic=True),
    "needs the least, comes and goes": Attack(
        "follower",
        lambda now, c: (
            {"needs_mps2": 0.001}
            if c.mode == "following" and not now.every(90.0, 45.0)
            else {"mode": "alone", "ahead": None, "leader": "v1", "needs_mps2": None}
        ),
        body=lambda now: -0.8 if now.every(90.0, 12.0) else None,
        traffic=True,
    ),
    "gap never closed": Attack(
        "follower",
        lambda now, c: {**_FOLLOWS, "gap_m": now.gap_m + 9.5, "front_m": c.front_m},
    ),
    "asks for all": Attack(
        "follower",
        lambda _now, _c: {"mode": "alone", "ahead": None, "leader": "v1", "needs_mps2": None},
        lambda _now: {"kind": "join_request", "slowdown": 1.0, "partner": "v0"},
        body=lambda now: -0.5 if now.every(320.0, 10.0) else None,
    ),
    "asks, comes and goes": Attack(
        "follower",
        lambda now, _c: (
            _FOLLOWS
            if now.every(320.0, 2.0)
            else {"mode": "alone", "ahead": None, "leader": "v1", "needs_mps2": None}
        ),
        lambda now: (
            {"kind": "leave", "partner": "v0"}
            if now.every(320.0, 2.0)
            else {"kind": "join_request", "slowdown": 1.0, "partner": "v0"}
        ),
    ),
    "follows from nowhere": Attack("beside", _beside(-64.6, **_FOLLOWS, gap_m=60.0)),
    "follows from nowhere, comes and goes": Attack(
        "beside",
        lambda now, c: _beside(-64.6, **(_FOLLOWS if now.every(60.0, 30.0) else {}), gap_m=6.0)(
            now, c
        ),
    ),
    "beside on another lane": Attack("beside", _beside(6.0, lane=1, platoon="p", place=0)),
    "ahead, and slow": Attack("beside", _beside(60.0, lane=0, speed_mps=10.0)),
}
"""By what is told."""


@dataclass(frozen=True)
class Harm:
    """What an attack did to the honest vehicles, the worst of them each.

    Attributes:
        slowdown_s: by how much later it is: ∫ max(0, 1 − v/v₀) dt; v₀ is the limit, or what the
            slowest rogue or the traffic ahead of it drives, if that is less.
        least_m: smallest gap to the vehicle ahead.
        above_law_m: smallest gap beyond the law's, with the limit that was promised last.
        reasons: why honest vehicles have left one another or the rogue.
    """

    slowdown_s: float
    least_m: float
    above_law_m: float
    reasons: tuple[str, ...]


class _Member(Vehicle):
    """Whose driver goes on after a stop, at the set speed; the rogue's body drives by its script
    where that says so.
    """

    script: Callable[[], float | None] | None = None

    def _wanted_mps2(self, now_s: float) -> float:
        forced = None if self.script is None else self.script()
        return super()._wanted_mps2(now_s) if forced is None else forced

    def _driver_mps2(self) -> float:
        gap_m, ahead_mps = self._seen[-1]
        cruise = None if self.last is None else self.last.cruise_mps
        wish_mps = self.leg.limits_mps[0] if cruise is None else cruise
        own = Own(self.speed_mps, wish_mps, wish_mps, 2.0, INTERVAL_S, PAPER_CAR, self.braking)
        follows = IDM.acceleration_to_mps2(own, gap_m, ahead_mps)
        emergency = self._emergency_mps2()
        least = -self.braking.guaranteed_mps2
        return max(least, min(follows, -emergency) if emergency > 0 else follows)


def harm(attack: Attack, case: Case, seconds: float) -> Harm:
    """What an attack does in a time."""
    return _RogueRun(attack, case).drive_on(seconds)


def harm_of(name: str, seconds: float) -> Harm:
    """What a named attack does to cars at 20 m/s."""
    return harm(ATTACKS[name], rogue_case(1), seconds)


def rogue_case(seed: int, speed_mps: float = 20.0, name: BrakingClass = "car") -> Case:
    """Two or three vehicles of one type on a dry road, under the declared noise."""
    road: Road = "dry"
    return Case(speed_mps, (name,) * 3, road, seed, 0.0, to_mps=speed_mps, loss=0.05)


class _RogueRun(Run):
    vehicles = _Member

    def __init__(self, attack: Attack, case: Case) -> None:
        count = 3 if attack.place in ("leader", "middle") else 2
        super().__init__(replace(case, classes=case.classes[:count], segment_m=9000.0))
        self.attack = attack
        self.number = {"leader": 0, "middle": 1, "follower": 1, "beside": -1}[attack.place]
        self.cruise_mps = (_CRUISE_SHARE if attack.traffic else 1.0) * case.speed_mps
        self.now_s = 0.0
        self.sequence = 1_000_000
        self.reasons: set[str] = set()
        for number, car in enumerate(self.cars):
            car.speed_mps = self.cruise_mps
            if isinstance(car, _Member) and number == self.number:
                car.script = self._script
        if attack.traffic:
            self.traffic = self.cars[0].place_m + LENGTH_M + _TRAFFIC_M, self.cruise_mps

    def _now(self) -> Now | None:
        first = self.cars[1 if self.number == 0 else 0].last
        if first is None or self.now_s < ATTACKS_AT_S:
            return None
        seen = None if self.number < 0 else self._ahead(self.number)
        gap_m = math.inf if seen is None else seen[0]
        return Now(self.now_s - ATTACKS_AT_S, first.control, gap_m)

    def _script(self) -> float | None:
        now = self._now()
        return None if now is None else self.attack.body(now)

    def drive_on(self, seconds: float) -> Harm:
        """Drive, and measure from the attack's begin on."""
        honest = [n for n in range(len(self.cars)) if n != self.number]
        slower = dict.fromkeys(honest, 0.0)
        limits: dict[int, float] = {}
        least_m = above_m = math.inf
        for step in range(round(seconds / STEP_S)):
            self.now_s = now_s = step * STEP_S
            self._step(now_s)
            if self.number < 0 and step % round(INTERVAL_S / STEP_S) == 0:
                self._haunt(now_s)
            if now_s < ATTACKS_AT_S:
                continue
            reference_mps = self.cruise_mps
            for number, car in enumerate(self.cars):
                if number == self.number:
                    reference_mps = min(reference_mps, car.speed_mps)
                    continue
                lost = 1 - car.speed_mps / max(reference_mps, 0.1)
                slower[number] += max(0.0, lost) * STEP_S
                if number == 0 or car.mode == "alone":
                    continue
                seen = self._ahead(number)
                assert seen is not None
                least_m = min(least_m, seen[0])
                told = self.cars[number - 1].last
                if told is not None and told.control.limit_mps2 is not None:
                    limits[number] = told.control.limit_mps2
                if number in limits:
                    law_m = least_gap_m(car.speed_mps, limits[number], car.braking)
                    above_m = min(above_m, seen[0] - law_m)
        return Harm(max(slower.values()), least_m, above_m, tuple(sorted(self.reasons)))

    def _publish(
        self,
        number: int,
        now_s: float,
        control: PlatoonControl,
        messages: Iterable[PlatoonManagement],
    ) -> None:
        now = self._now()
        if number != self.number or now is None:
            last = self.cars[number].last
            if last is not None and last.reason is not None and number != self.number:
                self.reasons.add(f"v{number}: {last.reason}")
            to_road = [one for one in messages if one.partner != GHOST]
            super()._publish(number, now_s, control, to_road)
            return
        change = self.attack.tell(now, control)
        if change is not None:
            super()._publish(number, now_s, control.model_copy(update=dict(change)), messages)
        self._ask(now, now_s, control.vehicle)

    def _haunt(self, now_s: float) -> None:
        now = self._now()
        if now is None:
            return
        self.sequence += 1
        base = now.v0.model_copy(
            update={
                "vehicle": GHOST,
                "sequence": self.sequence,
                "time_ns": BEGIN_NS + round(now_s * 1e9),
                "mode": "alone",
                "ahead": None,
                "leader": GHOST,
                "joined_by": None,
                "limit_mps2": None,
                "needs_mps2": None,
                "gap_m": None,
            }
        )
        change = self.attack.tell(now, base)
        if change is not None:
            for other in range(len(self.cars)):
                self._send(now_s, other, base.model_copy(update=dict(change)))
        self._ask(now, now_s, GHOST)

    def _ask(self, now: Now, now_s: float, vehicle: str) -> None:
        asked = self.attack.ask(now)
        if asked is None or not now.every(0.5, INTERVAL_S - 1e-6):
            return
        self.sequence += 1
        message = PlatoonManagement(
            vehicle=vehicle,
            sequence=self.sequence,
            time_ns=BEGIN_NS + round(now_s * 1e9),
            accepted=None,
            **asked,
        )
        self._send(now_s, int(message.partner[1:]), message)
