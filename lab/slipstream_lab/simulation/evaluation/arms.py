"""The arms of an evaluation: which there are, and which were asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from dispatcher_daemon.settings import AdviceSettings
from slipstream.errors import InputError
from slipstream_lab.simulation.closed_loop.policy import (
    LEVERS,
    WITHOUT_PRIORITY,
    Gating,
    Lever,
    Policy,
    installed_levers,
)

SHORTEST: Final = "A"
BASELINE: Final = "B"
COOPERATIVE: Final = "C"
EVERY_LEVER: Final = "C+"

PACES: Final = (0.88, 0.94, 1.06)
"""Of the baseline slowed and hurried, over the limit."""

NOISES: Final = (0.1, 0.2, 0.3)

EXOGENOUS: Final = "exogenous"
"""Asks for the paper's kind of evaluation too: `slipstream_lab.simulation.evaluation.exogenous`."""

INSTALLED: Final = "installed"
"""The dispatcher with the settings that an installation has by default."""
INSTALLED_PRIORITY: Final = "installed+"
"""The same with signal priority."""
INSTALLED_IDEAL: Final = "installed-ideal"
"""As installed, with the paper's ideal vehicles: what real brakes leave of its platoons."""
INSTALLED_OFF: Final = "installed-off"
"""The same dispatcher without advice and platoons: what dispatching alone makes of B."""

QUANTUM: Final = "C-lc-qaoa"
"""The cooperative arm with circuits for blocks. Slow: only by its name, in no selection."""

_GATINGS: Final[tuple[Gating, ...]] = ("open", "random")


def paced(pace: float) -> str:
    """Name of the baseline at a pace."""
    return f"{BASELINE}-{pace:.2f}"


def only(lever: Lever) -> str:
    """Name of the baseline with one lever."""
    return f"only-{lever}"


def without(lever: Lever) -> str:
    """Name of the arm with every lever but one; without priority that is the cooperative one."""
    return COOPERATIVE if lever == "priority" else f"without-{lever}"


def gated(gating: Gating) -> str:
    """Name of the cooperative arm with another gating."""
    return COOPERATIVE if gating == "rsu" else f"{COOPERATIVE}-{gating}"


def noisy(noise: float) -> str:
    """Name of the cooperative arm with noise on the features."""
    return COOPERATIVE if noise == 0 else f"{COOPERATIVE}-noise-{round(100 * noise)}"


def _installed(name: str, advice: AdviceSettings) -> Policy:
    return Policy(name, installed_levers(advice), installed=True)


def _policies() -> tuple[Policy, ...]:
    installed = (
        Policy(INSTALLED_OFF, installed=True),
        _installed(INSTALLED, AdviceSettings()),
        replace(_installed(INSTALLED_IDEAL, AdviceSettings()), brakes="ideal"),
        _installed(INSTALLED_PRIORITY, AdviceSettings(signal_priority=True)),
    )
    first, further = _of_paper()
    return (*first, *installed, *further)


def _of_paper() -> tuple[tuple[Policy, ...], tuple[Policy, ...]]:
    """The arms of the paper's tables, whose vehicles are ideal: those before and those after the
    installed ones.
    """
    every = frozenset(LEVERS)
    first = (
        Policy(SHORTEST, search="time"),
        Policy(BASELINE),
        *(Policy(paced(pace), pace=pace) for pace in PACES),
        Policy(COOPERATIVE, WITHOUT_PRIORITY),
        Policy(EVERY_LEVER, every),
    )
    further = (
        *(Policy(only(lever), frozenset({lever})) for lever in LEVERS),
        *(Policy(without(lever), every - {lever}) for lever in LEVERS if lever != "priority"),
        *(Policy(gated(gating), WITHOUT_PRIORITY, gating=gating) for gating in _GATINGS),
        *(Policy(noisy(noise), WITHOUT_PRIORITY, noise=noise) for noise in NOISES),
        Policy(QUANTUM, WITHOUT_PRIORITY, solver="lc-qaoa"),
    )
    return _ideal(first), _ideal(further)


def _ideal(policies: tuple[Policy, ...]) -> tuple[Policy, ...]:
    return tuple(replace(policy, brakes="ideal") for policy in policies)


POLICIES: Final = {policy.name: policy for policy in _policies()}
"""Every arm by its name, in the order of the tables."""

_INSTALLED: Final = (INSTALLED_OFF, INSTALLED, INSTALLED_PRIORITY)
_COMMON: Final = (BASELINE, *map(paced, PACES), COOPERATIVE)
_LEVERS: Final = (EVERY_LEVER, *map(only, LEVERS), *map(without, LEVERS))

SELECTIONS: Final[dict[str, tuple[str, ...]]] = {
    "all": tuple(name for name in POLICIES if name != QUANTUM),
    "main": (SHORTEST, *_COMMON, EVERY_LEVER, *_INSTALLED),
    "levers": (*_COMMON, *_LEVERS),
    "gating": (*_COMMON, *map(gated, _GATINGS)),
    "noise": (*_COMMON, *map(noisy, NOISES)),
}
"""Arms that are asked for together; each with what its savings are measured against."""


def choose(asked: str) -> tuple[Policy, ...]:
    """The arms that a comma-separated list of arms and selections names, each once, in the order
    of the tables; the baseline is always among them.

    Raises:
        InputError: an unknown name, or none at all.
    """
    names = [name.strip() for name in asked.split(",") if name.strip()]
    known = {**{name: (name,) for name in POLICIES}, **SELECTIONS, EXOGENOUS: ()}
    strange = next((name for name in names if name not in known), None)
    if strange is not None or not names:
        raise InputError(
            "evaluate",
            f"no arm {strange!r}" if strange else "no arm named",
            f"give some of: {', '.join((*SELECTIONS, EXOGENOUS, *POLICIES))}",
            key="--arms",
        )
    wanted = {BASELINE, *(arm for name in names for arm in known[name])}
    return tuple(policy for name, policy in POLICIES.items() if name in wanted)


def wants_exogenous(asked: str) -> bool:
    """Whether such a list asks for the exogenous evaluation too; `all` and `main` do."""
    return not {name.strip() for name in asked.split(",")}.isdisjoint({EXOGENOUS, "all", "main"})
