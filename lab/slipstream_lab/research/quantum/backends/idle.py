"""A device's noise with what its snapshot does not list: idle time and coherent errors.

Dynamical decoupling and Pauli twirling act on these alone, so that without them neither could show
what it is worth. Both are applied as a device's sampler does: pulses into the idle time of the
scheduled circuit, and Pauli frames around each CZ, drawn anew for each group of shots.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.backends import (
    DeviceNoise,
    NoisyBackend,
    Sampled,
    fake_target,
    fit,
    sample_noisy,
    sampled,
)
from slipstream.errors import InputError

DETUNING_HZ: Final = 20e3
"""ASSUMPTION: standard deviation of a qubit's detuning, constant during a shot. Some ten times what
a free-induction time of a third of FakeBoston's median T2 would give, in favour of decoupling."""
COHERENT_SHARE: Final = 0.5
"""ASSUMPTION: share of a CZ's calibrated error that is a constant ZZ rotation."""
GROUPS: Final = 8
"""Groups of shots with detunings, and Pauli frames, of their own."""

IDLE: Final = "+idle"
DECOUPLED: Final = "+dd"
TWIRLED: Final = "+twirl"
IDLE_ENDINGS: Final = tuple(
    IDLE + decoupled + twirled for decoupled in ("", DECOUPLED) for twirled in ("", TWIRLED)
)
"""What may follow a fake device's name."""

_IDLE: Final = "idle_"
_COHERENT: Final = "coherent"


class IdleNoise(DeviceNoise):
    """Noise of gates, of idle time by T1 and T2, and none of its own on coherent errors.

    Args:
        target: of a device whose two-qubit gate is CZ, with durations.

    Raises:
        InputError: it has none of either.
    """

    def __init__(self, target: Any) -> None:
        super().__init__(target)
        if "cz" not in target.operation_names or not target.dt or not target.qubit_properties:
            raise InputError(
                "backend",
                f"{target.description} has no CZ, or no times of gates and qubits",
                "take FakeBoston, or leave +idle out",
            )

    def _derive(self, name: str, qubits: tuple[int, ...]) -> Any:
        from qiskit.quantum_info import SuperOp
        from qiskit_aer.noise import thermal_relaxation_error

        if name == _COHERENT:
            return None
        if name.startswith(_IDLE):
            known = self.target.qubit_properties[qubits[0]]
            idle_s = int(name.removeprefix(_IDLE)) * self.target.dt
            return SuperOp(thermal_relaxation_error(known.t1, min(known.t2, 2 * known.t1), idle_s))
        return super()._derive(name, qubits)

    def _error(self, name: str, calibrated: float | None) -> float | None:
        if name != "cz" or calibrated is None:
            return calibrated
        return (1 - COHERENT_SHARE) * calibrated

    def rotation_rad(self, qubits: tuple[int, ...]) -> float:
        """Angle of the ZZ rotation behind a CZ, rad.

        By exp(−iφ ZZ / 2) on two qubits the mean gate fidelity falls by 4/5 · sin²(φ / 2).
        """
        calibrated = self.target["cz"][qubits].error or 0.0
        return float(2 * np.arcsin(np.sqrt(min(1.0, 1.25 * COHERENT_SHARE * calibrated))))


@dataclass(frozen=True)
class IdleBackend(NoisyBackend):
    """Aer with the noise of a fake device and errors of idle time and coherent ones.

    Attributes:
        decoupled, twirled: see `sample_with_idle`.
    """

    decoupled: bool = False
    twirled: bool = False

    @property
    def name(self) -> str:
        """As `open_backend` takes it."""
        ending = (DECOUPLED if self.decoupled else "") + (TWIRLED if self.twirled else "")
        return f"aer:{self.device}{IDLE}{ending}"

    @property
    def target(self) -> Any:
        """See `Backend.target`."""
        return self.noise.target

    @property
    def noise(self) -> IdleNoise:
        """The device's noise."""
        return _noise(self.device)

    def sample(self, circuit: Any, shots: int, seed: int, wait_s: float = 900.0) -> Sampled:
        """See `Backend.sample`."""
        began = time.perf_counter()
        transpiled = fit(circuit, self.target)
        counts = sample_with_idle(
            transpiled, self.noise, shots, seed, decoupled=self.decoupled, twirled=self.twirled
        )
        return sampled(self, counts, transpiled, began)


def open_idle(name: str) -> IdleBackend:
    """The backend of a fake device's name with one of `IDLE_ENDINGS`.

    Raises:
        InputError: there is no such device or ending.
    """
    device, plus, ending = name.partition("+")
    if plus + ending not in IDLE_ENDINGS:
        raise InputError(
            "backend",
            f"a fake device cannot have {plus + ending!r}",
            f"leave it out, or take one of +fractional {' '.join(IDLE_ENDINGS)}",
        )
    fake_target(device)
    return IdleBackend(
        device, decoupled=DECOUPLED in plus + ending, twirled=TWIRLED in plus + ending
    )


@lru_cache(maxsize=4)
def _noise(device: str) -> IdleNoise:
    """Noise, which learns a gate's noise once."""
    return IdleNoise(fake_target(device))


def sample_with_idle(
    circuit: Any,
    noise: IdleNoise,
    shots: int,
    seed: int,
    *,
    decoupled: bool,
    twirled: bool,
) -> dict[str, int]:
    """Counts by Qiskit bit string of a transpiled, measured circuit.

    Args:
        circuit: in the target's gates, on its qubits.
        noise: of the circuit's target.
        shots: number of samples.
        seed: of all draws; the same seed has the same detunings, however the circuit is treated.
        decoupled: with two X pulses in each idle time that they fit into.
        twirled: with random Pauli frames around each CZ.
    """
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    for shots_of_group in (len(part) for part in np.array_split(np.arange(shots), GROUPS)):
        detunings = rng.normal(0.0, 2 * np.pi * DETUNING_HZ, circuit.num_qubits)
        frames, samples = (int(drawn) for drawn in rng.integers(1, 2**31, 2))
        if not shots_of_group:
            continue
        framed = _twirled(circuit, noise.target, frames) if twirled else circuit
        timed = scheduled(framed, noise.target, decoupled=decoupled)
        erring = with_coherent_errors(timed, noise, detunings)
        counts.update(sample_noisy(erring, noise, shots_of_group, samples))
    return dict(counts)


def scheduled(circuit: Any, target: Any, *, decoupled: bool) -> Any:
    """A circuit with its idle time as delays in units of dt: each gate as late as it can be."""
    from qiskit.circuit.library import XGate
    from qiskit.transpiler import PassManager
    from qiskit.transpiler.passes import (
        ALAPScheduleAnalysis,
        PadDelay,
        PadDynamicalDecoupling,
        TimeUnitConversion,
    )

    passes = [TimeUnitConversion(target=target), ALAPScheduleAnalysis(target=target)]
    if decoupled:
        passes += [PadDynamicalDecoupling(target=target, dd_sequence=[XGate(), XGate()])]
    else:
        passes += [PadDelay(target=target)]
    return PassManager(passes).run(circuit)


def idle_s(circuit: Any, dt_s: float) -> dict[int, float]:
    """Time that each qubit of a scheduled circuit waits between its first and last gate, s."""
    begun: set[int] = set()
    found: Counter[int] = Counter()
    for instruction in circuit.data:
        for qubit in (circuit.find_bit(q).index for q in instruction.qubits):
            if instruction.operation.name != "delay":
                begun.add(qubit)
            elif qubit in begun:
                found[qubit] += instruction.operation.duration
    return {qubit: found[qubit] * dt_s for qubit in sorted(begun)}


def with_coherent_errors(circuit: Any, noise: IdleNoise, detunings: npt.NDArray[np.float64]) -> Any:
    """A scheduled circuit whose delays rotate about Z and whose CZs rotate about ZZ.

    Args:
        detunings: of each qubit, rad/s; shape (qubits,).
    """
    from qiskit.circuit import Instruction
    from qiskit.circuit.library import RZGate, RZZGate, UnitaryGate

    def named(gate: Any, name: str) -> Instruction:
        unitary = UnitaryGate(gate.to_matrix(), check_input=False)
        unitary.name = name
        return unitary

    erring = circuit.copy_empty_like()
    begun: set[int] = set()
    for instruction in circuit.data:
        operation = instruction.operation
        qubits = tuple(circuit.find_bit(q).index for q in instruction.qubits)
        if operation.name == "delay":
            # Until its first gate a qubit is in |0⟩, which neither phase nor decay changes.
            if qubits[0] in begun and operation.duration:
                angle = float(detunings[qubits[0]] * operation.duration * noise.target.dt)
                erring.append(named(RZGate(angle), f"{_IDLE}{operation.duration}"), qubits)
            continue
        begun.update(qubits)
        erring.append(instruction)
        if operation.name == "cz":
            erring.append(named(RZZGate(noise.rotation_rad(qubits)), _COHERENT), qubits)
    return erring


def _twirled(circuit: Any, target: Any, seed: int) -> Any:
    from qiskit.circuit import pauli_twirl_2q_gates
    from qiskit.transpiler import PassManager
    from qiskit.transpiler.passes import Optimize1qGatesDecomposition

    framed = pauli_twirl_2q_gates(circuit, "cz", seed=seed, target=target)
    return PassManager([Optimize1qGatesDecomposition(target=target)]).run(framed)
