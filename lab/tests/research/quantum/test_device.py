"""The linear-ramp test of a device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
import pytest

from dispatcher_daemon.solvers.protocol import BackendKind
from dispatcher_daemon.solvers.quantum.ansatz import linear_ramp, scheduled
from dispatcher_daemon.solvers.quantum.backends.base import Sampled
from dispatcher_daemon.solvers.quantum.backends.jobs import FaultKind, ServiceFault
from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement
from dispatcher_daemon.solvers.quantum.chain.state import ChainState
from slipstream_lab.research.quantum.device import (
    DELTA_BETA,
    DELTA_GAMMA,
    Cell,
    DeviceTestSettings,
    DeviceVerdict,
    as_markdown,
    chain_weights,
    conclusion,
    ideal_quality,
    max_cut,
    measure,
    quality,
    random_limit,
    verdicts,
)


def uniform_counts(n: int) -> dict[str, int]:
    """Each bit string once."""
    return {"".join(bits): 1 for bits in product("01", repeat=n)}


@dataclass
class Device:
    """A device that gives these counts by width and two-qubit depth, or a fault."""

    answers: Callable[[int, int], dict[str, int] | FaultKind]
    asked: list[tuple[int, int]] = field(default_factory=list)
    name: str = "device"
    kind: BackendKind = "hardware"
    target: Any = None

    def place(self, n: int, bond_weights: Any = None) -> QubitPlacement:
        """Not asked for."""
        raise NotImplementedError

    def sample(self, circuit: Any, shots: int, seed: int) -> Sampled:
        """The answer."""
        layers = circuit.count_ops()["rzz"] // (circuit.num_qubits - 1)
        self.asked.append((circuit.num_qubits, layers))
        answer = self.answers(circuit.num_qubits, layers)
        if isinstance(answer, str):
            raise ServiceFault(answer, f"the service is {answer}")
        return Sampled(answer, self.name, self.kind, 4 * layers, 2, 0.1)


def test_quality_is_the_share_of_the_largest_cut() -> None:
    """Alternating bits cut all of it, equal bits nothing, in Qiskit's order of bits."""
    weights = np.array([1.0, 0.5, 0.25])
    assert quality({"0101": 3, "1010": 1}, weights) == (1.0, 0.0, 4)
    assert quality({"0000": 2}, weights) == (0.0, 0.0, 2)
    # Bit 0 stands last: this cuts the first edge, of weight 1.
    assert quality({"0001": 1}, weights)[0] == pytest.approx(1.0 / 1.75)
    mean, error, shots = quality({"0101": 1, "0000": 1}, weights)
    assert (mean, error, shots) == (0.5, pytest.approx(0.5), 2)


def test_the_limit_is_three_sigma_of_uniform_bits() -> None:
    """By all bit strings: the mean is 1/2, and the variance that of the formula."""
    weights = chain_weights(6, seed=3)
    ratios = np.array([quality({text: 1}, weights)[0] for text in uniform_counts(6)])
    assert ratios.mean() == pytest.approx(0.5)
    assert random_limit(weights, 100) == pytest.approx(0.5 + 3 * ratios.std() / 10)


def test_the_ideal_quality_is_that_of_the_circuit() -> None:
    """By the other simulator, whose state is a matrix product."""
    weights = chain_weights(7, seed=1)
    ising = max_cut(weights)
    ansatz = scheduled(ising, linear_ramp(3, DELTA_BETA, DELTA_GAMMA))
    energy = ChainState(ansatz).energy(ising)
    expected = (1 - energy * weights.max() / weights.sum()) / 2
    assert ideal_quality(weights, 3) == pytest.approx(expected, abs=1e-5)
    assert expected > 0.7
    assert ideal_quality(chain_weights(21, seed=1), 1) is None


def test_a_width_ends_at_the_first_depth_that_is_random() -> None:
    """Deeper circuits are not asked for, and the verdict is the widest chain that passed."""

    def answers(width: int, layers: int) -> dict[str, int]:
        cut = "01" * (width // 2)
        return {cut: 8, cut[::-1]: 8} if width * layers < 12 else uniform_counts(width)

    device = Device(answers)
    settings = DeviceTestSettings(widths=(6, 4), layers=(2, 1, 3), shots=16)
    cells = measure(device, settings, lambda cell: None)
    assert device.asked == [(4, 1), (4, 2), (4, 3), (6, 1), (6, 2)]
    assert [c.above for c in cells] == [True, True, False, True, False]
    assert cells[0].signal is not None
    assert cells[0].signal > 1
    assert verdicts(cells) == [DeviceVerdict(4, 2, 1, True), DeviceVerdict(6, 1, 1, True)]
    assert "worth asking up to n = 6, p = 1;" in conclusion(verdicts(cells), "device")
    assert "| 6 | 2 |" in as_markdown(cells, "device", "hardware")


def test_nothing_above_random_is_not_worth_asking() -> None:
    """One circuit a width."""
    device = Device(lambda width, _: uniform_counts(width))
    settings = DeviceTestSettings(widths=(3, 4), layers=(1, 2), shots=16)
    cells = measure(device, settings, lambda cell: None)
    assert device.asked == [(3, 1), (4, 1)]
    assert "not worth asking" in conclusion(verdicts(cells), "device")


@pytest.mark.parametrize(("kind", "asked"), [("broken", 4), ("refused", 2), ("limited", 2)])
def test_a_job_that_fails_costs_its_cell_and_a_refusal_ends_the_test(
    kind: FaultKind, asked: int
) -> None:
    """What was measured stays; a depth behind a gap does not count."""

    def answers(width: int, layers: int) -> dict[str, int] | FaultKind:
        cut = "01" * (width // 2)
        return kind if (width, layers) == (4, 2) else {cut: 16}

    device, told = Device(answers), list[Cell]()
    settings = DeviceTestSettings(widths=(4,), layers=(1, 2, 3, 4), shots=16)
    cells = measure(device, settings, told.append)
    assert cells == told
    assert len(device.asked) == asked
    assert [c.fault is None for c in cells] == [True, False, True, True][:asked]
    assert verdicts(cells) == [DeviceVerdict(4, 1, 1, False)]
    assert f"the service is {kind}" in as_markdown(cells, "device", "hardware")
