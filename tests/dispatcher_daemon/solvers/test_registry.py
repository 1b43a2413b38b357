"""Solvers by name."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import EntryPoint

import pytest

from dispatcher_daemon import settings as settings_module
from dispatcher_daemon.forms.problem import Problem
from dispatcher_daemon.settings import BUILT_IN_SOLVERS, DispatcherSettings, solver_names
from dispatcher_daemon.solvers import registry
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.registry import SolverOptions, configured_solvers, make_solver
from slipstream import plugins
from slipstream.config import check
from slipstream.errors import InputError


@dataclass(frozen=True)
class Guess:
    """A solver of another package."""

    gamma: float | None
    name: str = "guess"

    def warm_up(self) -> None:
        """Nothing to import."""

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """It has no idea."""
        return Outcome(self.name, "failed", None, 0.0, reason="no idea")


def make_guess(options: SolverOptions) -> Guess:
    """Its factory."""
    return Guess(options.settings.gamma)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two packages add a solver each; one of them cannot be loaded."""
    group = settings_module.SOLVER_ENTRY_POINTS
    points = (
        EntryPoint("guess", f"{__name__}:make_guess", group),
        EntryPoint("broken", "no_such_package:make", group),
    )

    def entry_points(*, group: str, name: str | None = None) -> tuple[EntryPoint, ...]:
        return tuple(p for p in points if p.group == group and name in (None, p.name))

    monkeypatch.setattr(plugins, "entry_points", entry_points)
    monkeypatch.setattr(EntryPoint, "load", lambda point: _load(point))


def _load(point: EntryPoint) -> object:
    if point.name == "broken":
        raise ModuleNotFoundError("No module named 'no_such_package'")
    return make_guess


def test_every_built_in_name_makes_a_solver_of_that_name() -> None:
    """Settings and registry know the same solvers."""
    assert set(registry._FACTORIES) == set(BUILT_IN_SOLVERS)
    for name in BUILT_IN_SOLVERS:
        assert make_solver(name, DispatcherSettings()).name == name


@pytest.mark.usefixtures("installed")
def test_a_package_adds_a_solver_by_an_entry_point() -> None:
    """It can be named in the settings and is made with them, beside the baseline's solver."""
    assert "guess" in solver_names()
    settings = check({"solvers": ["guess"], "gamma": 2.0}, DispatcherSettings, "test")
    assert [solver.name for solver in configured_solvers(settings)] == ["exact", "guess"]
    assert make_solver("guess", settings) == Guess(2.0)


@pytest.mark.usefixtures("installed")
def test_a_package_that_cannot_be_loaded_is_named() -> None:
    """One line says which object of which solver is at fault."""
    with pytest.raises(InputError, match="solver broken: no_such_package:make cannot be loaded"):
        make_solver("broken", DispatcherSettings())


def test_an_unknown_solver_is_bad_input() -> None:
    """The line names the key and the solvers that there are."""
    with pytest.raises(InputError, match=r"solvers\.0: there is no such solver, there are exact"):
        check({"solvers": ["magic"]}, DispatcherSettings, "test")
    with pytest.raises(InputError, match="there is no such solver"):
        make_solver("magic", DispatcherSettings())
