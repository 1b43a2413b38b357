"""QAOA on all 2^n states: precomputed diagonal, transverse mixer as small real matrices.

With S = diag(1, i) on every qubit, R_X(θ) = S† R_Y(θ) S. S commutes with the diagonal, so that
S ψ evolves under real matrices R_Y and probabilities are the same. Real and imaginary parts are
kept apart: the mixer of five qubits is one product of a real 32 × 32 matrix with each of them.
"""

from __future__ import annotations

import math
import os
from functools import reduce

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.statevector.diagonal import Diagonal
from dispatcher_daemon.solvers.quantum.statevector.exact_state import (
    ExactState,
    Schedule,
    States,
    in_threads,
)

Real = npt.NDArray[np.float32]

_LOW_BITS = 15
"""A block of 2^15 amplitudes and its work space stay in a core's cache."""
_TILE_BITS = 16
_TURN = np.array([[-1], [1]], dtype=np.float32)
_GROUP = 5
_GEMM_BITS = 18
"""OpenBLAS starts threads of its own from m · n · k > 2^18, which fight with the ones here."""


def memory_bytes(qubits: int) -> int:
    """Memory that a `StateVector` needs with its diagonal: 12 · 2^n."""
    return 12 << qubits


class StateVector(ExactState):
    """State of n qubits from |+⟩^n; qubit 0 is the least significant bit of a state's number.

    Single precision: 8 bytes of amplitude and 4 of energy a state: 384 MiB at 25 qubits, 1.5 GiB at
    27; work space below 4 MiB a thread.

    Args:
        diagonal: C by state, shape (2^n,), n ≥ 1.
        threads: None: one for each core.
    """

    def __init__(self, diagonal: Diagonal, threads: int | None = None) -> None:
        self.qubits = len(diagonal).bit_length() - 1
        if len(diagonal) != 1 << self.qubits or self.qubits < 1:
            raise ValueError(f"a diagonal of {len(diagonal)} states")
        self._low = min(self.qubits, _LOW_BITS)
        super().__init__(diagonal, 1 << self._low, threads or os.cpu_count() or 1)
        self._parts = np.empty((2, 0), dtype=np.float32)
        turns = np.bitwise_count(np.arange(1 << self._low, dtype=np.uint32)) & 3
        plus = np.array([[1, 0, -1, 0], [0, 1, 0, -1]]) * 2.0 ** (-self.qubits / 2)
        self._plus = plus.astype(np.float32)[:, turns]

    def evolve(self, schedule: Schedule) -> None:
        """e^{−iγC}, then e^{+iβΣX}, for each layer in turn; before that there is no state.

        Raises:
            ValueError: no layers.
        """
        if not schedule:
            raise ValueError("a schedule without layers")
        if self._parts.size == 0:
            self._parts = np.empty((2, len(self.diagonal)), dtype=np.float32)
        for layer, (beta, gamma) in enumerate(schedule):
            self._phase_and_low_mixer(beta, gamma, first=layer == 0)
            if self.qubits > self._low:
                self._high_mixer(beta)

    def probabilities(self, first: int, last: int) -> Real:
        """See `ExactState`."""
        p = np.square(self._parts[0, first:last])
        p += np.square(self._parts[1, first:last])
        return p

    def amplitudes(self) -> npt.NDArray[np.complex64]:
        """The state itself, shape (2^n,): 8 · 2^n bytes more."""
        turns = np.bitwise_count(np.arange(len(self.diagonal), dtype=np.uint32)) & 3
        unturned = np.array([1, -1j, -1, 1j], dtype=np.complex64)[turns]
        return np.asarray((self._parts[0] + 1j * self._parts[1]) * unturned, dtype=np.complex64)

    def bits(self, states: States) -> npt.NDArray[np.int8]:
        """See `ExactState`."""
        return ((states[:, None] >> np.arange(self.qubits)) & 1).astype(np.int8)

    def _plus_block(self, number: int) -> Real:
        """Block of S|+⟩^n: amplitudes i^(number of ones) / 2^(n/2); shape (2, block)."""
        ones = number.bit_count()
        turned: Real = self._plus[::-1] * _TURN if ones & 1 else self._plus
        return -turned if ones & 2 else turned

    def _phase_and_low_mixer(self, beta: float, gamma: float, *, first: bool) -> None:
        matrices = [_rotation(beta, size) for size in _groups(self._low)]
        block = self._block

        def work(start: int, end: int) -> None:
            turned, cosine, sine, spare = np.empty((4, block), dtype=np.float32)
            for number in range(start, end):
                part = slice(number * block, (number + 1) * block)
                results = self._parts[:, part]
                real, imaginary = self._plus_block(number) if first else results
                np.multiply(self.diagonal[part], np.float32(gamma), out=spare)
                np.cos(spare, out=cosine)
                np.sin(spare, out=sine)
                np.multiply(real, cosine, out=turned)
                np.multiply(imaginary, sine, out=spare)
                turned += spare
                sine *= real
                np.multiply(imaginary, cosine, out=spare)
                spare -= sine
                _mix_low(matrices, turned, results[0], (cosine, sine))
                _mix_low(matrices, spare, results[1], (cosine, sine))

        in_threads(work, len(self.diagonal) // block, self.threads)

    def _high_mixer(self, beta: float) -> None:
        bits = self.qubits - self._low
        sizes = _groups(bits)
        matrices = [_rotation(beta, size) for size in sizes]
        columns = min(self._block, max(32, 1 << (_TILE_BITS - bits)))
        rows = self._parts.reshape(2, 1 << bits, self._block)

        def work(start: int, end: int) -> None:
            # Rows lie far apart: a tile of columns is copied out, mixed and put back.
            tile, other = np.empty((2, 1 << bits, columns), dtype=np.float32)
            for number in range(start, end):
                for part in rows:
                    source = part[:, number * columns : (number + 1) * columns]
                    np.copyto(tile, source)
                    after = columns
                    for matrix in matrices:
                        _product(
                            matrix,
                            tile.reshape(-1, len(matrix), after),
                            other.reshape(-1, len(matrix), after),
                        )
                        tile, other = other, tile
                        after *= len(matrix)
                    np.copyto(source, tile)

        in_threads(work, self._block // columns, self.threads)


def _groups(bits: int) -> list[int]:
    """Sizes of groups of qubits, as equal as can be, least significant first."""
    count = math.ceil(bits / _GROUP)
    return [(bits + i) // count for i in range(count)]


def _rotation(beta: float, size: int) -> Real:
    """R_Y(−2β) on each of some qubits, shape (2^size, 2^size); R_X(−2β) = e^{iβX}."""
    c, s = math.cos(beta), math.sin(beta)
    one = np.array([[c, s], [-s, c]])
    return reduce(np.kron, [one] * size).astype(np.float32)


def _mix_low(matrices: list[Real], source: Real, result: Real, spare: tuple[Real, Real]) -> None:
    """Each product takes the lowest group and puts it on top, so that at last all are in place."""
    for number, matrix in enumerate(matrices):
        target = result if number == len(matrices) - 1 else spare[number % 2]
        lowest = source.reshape(-1, len(matrix)).T
        _product(matrix, lowest[None], target.reshape(1, len(matrix), -1))
        source = target


def _product(matrix: Real, source: Real, result: Real) -> None:
    """matrix @ source for each of a stack of matrices, in products small enough for one thread."""
    columns = source.shape[2]
    size = min(columns, (1 << _GEMM_BITS) // len(matrix) ** 2)

    def sliced(stack: Real) -> Real:
        stack_step, row_step, step = stack.strides
        return np.lib.stride_tricks.as_strided(
            stack,
            (stack.shape[0], columns // size, len(matrix), size),
            (stack_step, size * step, row_step, step),
        )

    np.matmul(matrix, sliced(source), out=sliced(result))
