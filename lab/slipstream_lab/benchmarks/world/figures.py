"""Figures of the worlds, and their targets; no I/O."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from slipstream_lab.benchmarks.aims import Check

MAX_BACKGROUND_S: Final = 120.0
MAX_ARM_S: Final = 600.0
MIN_EVERY: Final = 0.185
MIN_WITHOUT_PRIORITY: Final = 0.10
MIN_OF_DRAFTING: Final = 0.80
MAX_LOST: Final = 0.10

DAY_H: Final = 24.0


@dataclass(frozen=True)
class TimedRun:
    """One simulation."""

    what: str
    scenario: str
    seed: int
    hours: float
    wall_s: float
    cpu_s: float
    peak_mb: float
    beside: int = 0
    faults: tuple[str, ...] = ()


@dataclass(frozen=True)
class Repeat:
    """Two runs of the same evaluation."""

    scenario: str
    hours: float
    arms: str
    files: int
    different: tuple[str, ...]


@dataclass(frozen=True)
class Saved:
    """Result of an evaluation, means over its seeds, shares of the baseline's energy.

    Attributes:
        every: saving with every lever at equal travel time; None where it was not simulated, as
            everywhere here.
    """

    scenario: str
    hours: float
    seeds: tuple[int, ...]
    every: float | None
    without_priority: float | None
    noisy: float | None
    drag: float | None
    drafting_ceiling: float | None
    refused: tuple[str, ...] = ()

    @property
    def lost_by_noise(self) -> float | None:
        """Relative loss of the saving with 20 % noise; None without a saving."""
        if self.noisy is None or self.without_priority is None or self.without_priority <= 0:
            return None
        return 1 - self.noisy / self.without_priority

    @property
    def of_drafting(self) -> float | None:
        """Drag saved as a share of the drafting ceiling."""
        if self.drag is None or not self.drafting_ceiling:
            return None
        return self.drag / self.drafting_ceiling


def time_checks(runs: Sequence[TimedRun]) -> list[Check]:
    """Times of whole days; of parts of a day they are shown and not judged."""
    found = []
    for scenario in dict.fromkeys(run.scenario for run in runs):
        own = [run for run in runs if run.scenario == scenario]
        groups = (
            ("background", [r for r in own if r.what == "background"], MAX_BACKGROUND_S),
            ("arm on one core", [r for r in own if _is_arm(r) and not r.beside], MAX_ARM_S),
            ("two arms side by side", [r for r in own if _is_arm(r) and r.beside], MAX_ARM_S),
        )
        for what, group, most in groups:
            if group:
                worst = max(group, key=lambda run: run.wall_s)
                whole = worst.hours == DAY_H
                found.append(
                    Check(
                        f"{scenario}, {what}, {worst.hours:g} h, s, worst of {len(group)}",
                        f"{worst.wall_s:.0f} ({worst.cpu_s:.0f} of processor time)",
                        f"≤ {most:g} for 24 h",
                        worst.wall_s <= most if whole else None,
                    )
                )
    unfit = [run for run in runs if run.faults]
    if unfit:
        text = "; ".join(f"{r.scenario} {r.seed}: {', '.join(r.faults)}" for r in unfit)
        found.append(Check("days that are not fit", text, "none", False))
    return found


def repeat_checks(repeats: Sequence[Repeat]) -> list[Check]:
    """Same seed, same table."""
    return [
        Check(
            f"{r.scenario}, {r.hours:g} h simulated twice: files that are not the same bytes",
            f"{len(r.different)} of {r.files}",
            "0",
            not r.different and r.files > 0,
        )
        for r in repeats
    ]


def saving_checks(saved: Sequence[Saved]) -> list[Check]:
    """Savings of whole days; of parts of a day they are shown and not judged."""
    found = []
    for one in saved:
        whole = one.hours == DAY_H
        of = f"{one.scenario}, {one.hours:g} h, {_seeds(one.seeds)}"
        rows: list[tuple[str, float | None, str, bool | None]] = []
        if one.scenario == "corridor":
            reached = one.of_drafting
            rows.append(
                (
                    "saved by drafting, of what every kilometre drafted would save",
                    reached,
                    f"≥ {MIN_OF_DRAFTING:.0%}",
                    None if reached is None else reached >= MIN_OF_DRAFTING,
                )
            )
        for words, value, least in (
            ("every lever, saving at equal travel time", one.every, MIN_EVERY),
            ("without priority", one.without_priority, MIN_WITHOUT_PRIORITY),
        ):
            aim = f"≥ {100 * least:g} %" if one.scenario != "corridor" else "–"
            judged = None if value is None or one.scenario == "corridor" else value >= least
            rows.append((words, value, aim, judged))
        lost = one.lost_by_noise
        if one.noisy is not None:
            rows.append(
                (
                    "of the saving, what 20 % noise costs",
                    lost,
                    f"≤ {MAX_LOST:.0%}",
                    None if lost is None else lost <= MAX_LOST,
                )
            )
        for words, value, aim, judged in rows:
            shown = "–" if value is None else f"{100 * value:.2f} %"
            found.append(Check(f"{of}: {words}", shown, aim, judged if whole else None))
        if one.refused:
            found.append(Check(f"{of}: arms refused", ", ".join(one.refused), "none", False))
    return found


def _is_arm(run: TimedRun) -> bool:
    return run.what != "background"


def _seeds(seeds: Sequence[int]) -> str:
    return f"seed{'s' if len(seeds) > 1 else ''} {', '.join(map(str, seeds))}"
