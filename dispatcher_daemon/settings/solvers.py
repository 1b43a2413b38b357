"""Settings of the solvers, and which there are."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from dispatcher_daemon.settings.tuned import TunedSettings
from slipstream.plugins import plugin_names

BUILT_IN_SOLVERS: Final = ("exact", "cplex", "tabu", "annealing", "insertion", "lc-qaoa", "qaoa")
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
    "ramp", "trained", "multi-angle", "product", "one-hot", "one-hot-multi-angle", "one-hot-product"
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
    layers: int = Field(default=2, ge=1, le=10, description="Depth p; the cost grows with 4^p.")
    shots: int = Field(
        default=4096, ge=1, le=1_000_000, description="Number of samples of the circuit."
    )
    delta_beta: float = 0.3
    """Height of the mixer's ramp, rad."""
    delta_gamma: float = 0.6
    """Height of the phase's ramp, rad."""
    iterations: int = Field(
        default=100,
        ge=1,
        le=100_000,
        description="Maximum number of energy evaluations in training, for each restart.",
    )
    restarts: int = 16
    """Number of starting points of training with an angle for each gate."""
    spread: float = 0.5
    """Standard deviation of the restarts' angles around the ramp, rad."""
    cvar_share: float = 1.0
    """Share of the samples, lowest energies first, whose mean energy the variant trained
    minimises (CVaR); 1: all energies."""
    order: Literal["heavy", "random"] = "heavy"
    """Order of the chain: along heavy couplings, or drawn at random."""
    backend: str = Field(
        default="aer",
        pattern=r"^aer(|:Fake[A-Za-z0-9]+(|\+fractional))$",
        description="Simulator: aer, or aer:FakeBoston with that device's noise. A device is set "
        "in hardware.backend, where a budget holds.",
    )


class QaoaSettings(TunedSettings):
    """QAOA with all couplings, on an exactly simulated state."""

    variant: Literal["x", "xy"] = Field(
        default="x",
        description="Mixer: x on all 2^n states; xy keeps one option of each vehicle (route form "
        "only).",
    )
    layers: int = Field(default=2, ge=1, le=20)
    """Depth p."""
    shots: int = Field(default=4096, ge=1, le=1_000_000)
    """Number of samples of the circuit."""
    angles: Literal["transferred", "trained", "ramp"] = "transferred"
    """transferred: the linear ramp of delta_beta and delta_gamma without training; trained:
    all 2p angles from that ramp on, by COBYLA; ramp: only the ramp's two heights."""
    delta_beta: float | None = None
    """Height of the mixer's ramp, rad; None: as measured for p and mixer."""
    delta_gamma: float | None = None
    """Height of the phase's ramp, rad; None: as measured for p and mixer."""
    iterations: int = Field(default=100, ge=1, le=100_000)
    """Maximum number of state evaluations in training."""
    alpha: float = 1.0
    """Share of the probability, lowest energies first, whose mean energy training minimises
    (CVaR); 1: all of it."""
    pairs: Literal["ring", "chain"] = "ring"
    """Pairs of options that the xy mixer acts on."""
