"""Settings of the solvers, and which there are."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from slipstream.config import TunedSettings
from slipstream.plugins import plugin_names

BUILT_IN_SOLVERS: Final = (
    "exact",
    "cplex",
    "tabu",
    "annealing",
    "insertion",
    "lc-qaoa",
    "qaoa",
)
SOLVER_ENTRY_POINTS: Final = "slipstream.solvers"
"""Group of entry points by which installed packages add solvers; see `solvers.registry`."""


def solver_names() -> tuple[str, ...]:
    """Names of all solvers that a cycle can ask: the built-in ones, then those of packages."""
    return plugin_names(SOLVER_ENTRY_POINTS, BUILT_IN_SOLVERS)


def _known_solver(name: str) -> str:
    # Built-in names first: to know the others, all installed packages are looked through.
    if name not in BUILT_IN_SOLVERS and name not in (names := solver_names()):
        raise ValueError(f"there is no such solver, there are {', '.join(names)}")
    return name


SolverName = Annotated[str, AfterValidator(_known_solver)]

HARDWARE_SOLVER: Final[SolverName] = "lc-qaoa"
"""The solver whose circuits go to the device that `HardwareSettings` names."""


LcQaoaVariant = Literal[
    "ramp",
    "trained",
    "multi-angle",
    "product",
    "one-hot",
    "one-hot-multi-angle",
    "one-hot-product",
]


class LcQaoaSettings(TunedSettings):
    """Linear-chain QAOA: which circuit, how it is trained, how often it is sampled."""

    variant: LcQaoaVariant = Field(
        default="trained",
        description="ramp: untrained; trained: the paper's, 2p angles by COBYLA; multi-angle: each "
        "gate its own angle; product: the same without entangling gates, its control; one-hot, "
        "one-hot-multi-angle, one-hot-product: the last three with one option of each vehicle by "
        "construction (route form only).",
    )
    layers: int = Field(default=2, ge=1, le=10)
    """Depth p; the cost grows with 4^p."""
    shots: int = Field(default=4096, ge=1, le=1_000_000)
    """Number of samples of the circuit."""
    iterations: int = Field(default=100, ge=1, le=100_000)
    """Maximum number of energy evaluations in training, for each restart."""
    backend: str = Field(
        default="aer",
        pattern=r"^aer(|:Fake[A-Za-z0-9]+(|\+fractional))$",
        description="Simulator: aer, or aer:FakeBoston with that device's noise. A device is set "
        "in hardware.backend, where a budget holds.",
    )


class QaoaSettings(TunedSettings):
    """QAOA with all couplings, on an exactly simulated state."""

    variant: Literal["x", "xy"] = "x"
    """Mixer: x on all 2^n states; xy keeps one option of each vehicle (route form only)."""
