"""The world of an evaluation: its files, its days' backgrounds, and arms in it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from slipstream.braking import Road
from slipstream.vehicle_types import PresetName
from slipstream_lab.simulation.closed_loop.arm import STEP_S, ArmSpec, home_by_s, run_arm
from slipstream_lab.simulation.closed_loop.history_file import save_history
from slipstream_lab.simulation.closed_loop.history_recording import (
    history_file,
    history_of,
    record_history,
)
from slipstream_lab.simulation.closed_loop.policy import AS_DRIVING, Policy, WaitingPrices
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.runs.provenance import Provenance, provenance_of
from slipstream_lab.simulation.scenarios.demand import DAY_S
from slipstream_lab.simulation.scenarios.record import HOUR_S
from slipstream_lab.simulation.scenarios.scenario import (
    BackgroundTraffic,
    Scenario,
    SignalControl,
    day_spec,
    load_scenario,
    made_up,
    prepare,
)
from slipstream_lab.simulation.sumo import Progress

RunArm = Callable[[ArmSpec, Progress], ArmResult]


@dataclass(frozen=True)
class WorldFiles:
    """A scenario as a user names it. `net`: a SUMO net of the user's; `type`: of the fleet's
    vehicles, None: the fleet's own.
    """

    name: str
    net: Path | None = None
    demand: Path | None = None
    routes: tuple[Path, ...] = ()
    rsus: Path | None = None
    fleet: Path | None = None
    additional: tuple[Path, ...] = ()
    type: PresetName | None = None

    def load(self) -> Scenario:
        """The scenario. Raises InputError: no such scenario, or a file that is malformed or does
        not fit the net.
        """
        return load_scenario(
            self.name,
            net=self.net,
            demand=self.demand,
            rsus=self.rsus,
            fleet=self.fleet,
            type=self.type,
            routes=self.routes,
            additional=self.additional,
        )


class World:
    """Simulates arms; several threads may ask at once.

    Args:
        span_s: begin and end of the time in which orders are released; the begin a multiple of 300.

    Raises:
        InputError: the scenario's files are missing or faulty.
    """

    def __init__(
        self,
        files: WorldFiles,
        folder: Path,
        signals: SignalControl,
        span_s: tuple[float, float],
        prices: WaitingPrices = AS_DRIVING,
        road: Road = "dry",
    ) -> None:
        self._files = files
        self._folder = folder
        self._signals = signals
        self._span_s = span_s
        self._prices, self._road = prices, road
        self._scenario = files.load()
        self._lock = threading.Lock()
        self._recording: dict[int, threading.Lock] = {}
        self._backgrounds: dict[int, tuple[BackgroundTraffic, tuple[Path, ...]]] = {}

    @property
    def provenance(self) -> Provenance:
        """What its arms' results depend on."""
        return provenance_of(
            self._scenario, self._signals, self._span_s, STEP_S, self._prices, self._road
        )

    @property
    def folder(self) -> Path:
        """With the route files of the seeds."""
        return self._folder

    @property
    def files(self) -> WorldFiles:
        """As the user named them."""
        return self._files

    @property
    def scenario(self) -> Scenario:
        """The world itself."""
        return self._scenario

    def background(self, seed: int) -> BackgroundTraffic:
        """A seed's background, made when first needed. Raises InputError: it cannot be made."""
        return self._background(seed)[0]

    def made_up(self, seed: int) -> tuple[str, ...]:
        """What of the world nobody gave, a line each; of a seed what hangs on it."""
        own, given = self._scenario, self._scenario.rsus is not None and self._scenario.fleet.depots
        return () if given and not own.made_up else made_up(own, self.background(seed), seed)

    def simulate(
        self,
        policy: Policy,
        seed: int,
        progress: Progress,
        run: RunArm | None = None,
        databases: Path | None = None,
    ) -> ArmResult:
        """Simulate an arm.

        Args:
            databases: folder for a database of the arm; None: it gets none.

        Raises:
            InputError: the background cannot be made, or SUMO cannot run it.
            ModuleNotFoundError: libsumo is not installed.
        """
        background, additional = self._background(seed)
        begin_s, end_s = self._span_s
        order = ArmSpec(
            scenario=self._files.name,
            background=background.files,
            rsus=background.rsus,
            seed=seed,
            policy=policy,
            net=self._files.net,
            fleet=self._files.fleet,
            own_routes=bool(self._files.routes),
            additional=additional,
            history=self._history(seed, progress) if "routes" in policy.levers else None,
            begin_s=begin_s,
            end_s=end_s,
            step_s=STEP_S,
            database=None if databases is None else databases / f"{policy.name}-{seed}.db",
            prices=self._prices,
            road=self._road,
            type=self._files.type,
        )
        return (run or run_arm)(order, progress)

    def _history(self, seed: int, progress: Progress) -> Path:
        """What movements cost in these hours of another day, recorded when an arm needs it.

        Of the user's own routes there is no other day: they are what is learned from.
        """
        begin_s, end_s = self._span_s
        home_s = home_by_s(self._scenario.fleet, end_s)
        hours_s = begin_s // HOUR_S * HOUR_S, min(-(-home_s // HOUR_S) * HOUR_S, DAY_S)
        own = bool(self._files.routes)
        with self._lock:
            lock = self._recording.setdefault(0 if own else seed, threading.Lock())

        def at_begin(*_: float) -> None:
            progress(begin_s, end_s)

        with lock:  # not all of them: other seeds, and arms without a history, go on
            if not own:
                return history_of(
                    self._scenario,
                    seed,
                    self._folder,
                    signals=self._signals,
                    begin_s=hours_s[0],
                    end_s=hours_s[1],
                    progress=at_begin,
                )
            background = self._background(seed)[0]
            files = (self._scenario.net, *background.files, *self._scenario.additional)
            depends_on = [path.read_bytes() for path in files]
            path = history_file(
                self._folder, f"{self._files.name}-routes", self._signals, hours_s, depends_on
            )
            if not path.exists():
                day = day_spec(
                    self._scenario,
                    background,
                    self._folder,
                    signals=self._signals,
                    begin_s=hours_s[0],
                    end_s=hours_s[1],
                )
                save_history(record_history(day, self._scenario.network, at_begin), path)
            return path

    def _background(self, seed: int) -> tuple[BackgroundTraffic, tuple[Path, ...]]:
        """A seed's background and further files, made when the first arm of it needs them."""
        with self._lock:
            if seed not in self._backgrounds:
                self._folder.mkdir(parents=True, exist_ok=True)
                background = prepare(self._scenario, seed, self._folder)
                day = day_spec(self._scenario, background, self._folder, signals=self._signals)
                self._backgrounds[seed] = background, day.additional
            return self._backgrounds[seed]
