"""The motion of vehicles along a segment from noisy positions: a Gaussian-process smoother.

Position is s(t) = s₀ + v₀ t + ∬ a, with the acceleration a zero-mean Gaussian process of variance
σ²_a and a Matérn-3/2 correlation (Rasmussen & Williams, Gaussian Processes, 2006, eq. 4.17), s₀ and
v₀ unknown (ibid., eq. 2.41). It is the smoother of a Singer-like manoeuvre model (Singer, IEEE
Trans. AES 6, 1970) over the whole window. How strong accelerations and noise are is taken from the
data: the two variance components are estimated by restricted maximum likelihood over all vehicles
of the segment, so that calm traffic is smoothed hard and rough traffic is not flattened.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from edge_daemon.camera import Array

BIN_S: Final = 0.2
"""Positions are averaged over so long before smoothing: little is lost, much time is won."""
MOST_BINS: Final = 24
"""A vehicle that is in view for long gets longer bins: smoothing costs the cube of their number."""
CORRELATION_S: Final = 2.5
"""Length scale of the acceleration's correlation."""
NOISE_CORRELATION_S: Final = 0.05
"""For so long most of a box's error stays: the detector sees nearly the same picture."""
SLOW_SHARE: Final = 0.6
"""Share of a box's error variance that stays for longer: the same side hidden, the same shape."""
SLOW_CORRELATION_S: Final = 1.0
_PRIOR_OBSERVATIONS: Final = 10.0
_LIKELY_ACCELERATION_VARIANCE: Final = 0.3
_LEAST, _MOST = 1e-4, 50.0


@dataclass(frozen=True)
class Positions:
    """Where one vehicle was along the segment, condensed.

    Attributes:
        time_s: increasing, shape (n,).
        along_m: shape (n,).
        variance_m2: of `along_m`, independent between positions, shape (n,).
        slow_m2: of the part of the error that neighbouring positions share, shape (n,).
    """

    time_s: Array
    along_m: Array
    variance_m2: Array
    slow_m2: Array

    def __len__(self) -> int:
        return len(self.time_s)


def condense(time_s: Array, along_m: Array, variance_m2: Array) -> Positions:
    """Average positions over bins, weighted by their certainty.

    Boxes of neighbouring frames err alike, r(Δt) = exp(−Δt / NOISE_CORRELATION_S): each position
    counts for less, the closer the frames lie, by (1 + r)/(1 − r) for an AR(1) process.

    Args:
        time_s: increasing, shape (n,), n ≥ 2.
        along_m: shape (n,).
        variance_m2: of one position, shape (n,).
    """
    alike = np.exp(-np.diff(time_s, prepend=-np.inf) / NOISE_CORRELATION_S)
    weight = (1 - alike) / (1 + alike) / variance_m2
    bin_s = max(BIN_S, float(time_s[-1] - time_s[0]) / MOST_BINS)
    number = np.floor((time_s - time_s[0]) / bin_s + 1e-6).astype(np.intp)
    _, of = np.unique(number, return_inverse=True)
    total = np.bincount(of, weight)
    return Positions(
        np.bincount(of, weight * time_s) / total,
        np.bincount(of, weight * along_m) / total,
        (1 - SLOW_SHARE) / total,
        SLOW_SHARE * np.bincount(of, weight * variance_m2) / total,
    )


@dataclass(frozen=True)
class Components:
    """What the positions of a segment's vehicles vary by.

    Attributes:
        acceleration_variance: of the process, (m/s²)².
        noise_scale: the positions' true variance over the stated one.
    """

    acceleration_variance: float
    noise_scale: float


@dataclass(frozen=True)
class Motion:
    """Smoothed motion of one vehicle at its condensed positions.

    Attributes:
        time_s: shape (n,).
        along_m: shape (n,).
        speed_mps: shape (n,).
        acceleration_mps2: shape (n,).
        speed_covariance: shape (n, n).
        acceleration_covariance: shape (n, n).
    """

    time_s: Array
    along_m: Array
    speed_mps: Array
    acceleration_mps2: Array
    speed_covariance: Array
    acceleration_covariance: Array


class Fit:
    """One vehicle's positions, ready for estimating components and for smoothing."""

    def __init__(self, positions: Positions) -> None:
        """Set up the process at the positions' times; at least three of them."""
        self.positions = positions
        n = len(positions)
        time = positions.time_s - positions.time_s[0]
        to_speed, to_along = _integrals(time)
        distance = np.sqrt(3.0) * np.abs(time[:, None] - time[None]) / CORRELATION_S
        correlation: Array = (1 + distance) * np.exp(-distance)
        # Covariances for σ²_a = 1: of position, speed and acceleration with position, of each.
        with_along = correlation @ to_along.T
        self._of_along = to_along @ with_along
        self._with_along = np.vstack([self._of_along, to_speed @ with_along, with_along])
        self._of_speed = to_speed @ correlation @ to_speed.T
        self._of_acceleration = correlation
        slow = np.sqrt(positions.slow_m2)
        apart = np.abs(time[:, None] - time[None]) / SLOW_CORRELATION_S
        self._noise: Array = slow[:, None] * slow * np.exp(-apart) + np.diag(positions.variance_m2)
        # What s₀ and v₀ add to position, speed and acceleration.
        self._start = np.zeros((3 * n, 2))
        self._start[:n, 0] = self._start[n : 2 * n, 1] = 1.0
        self._start[:n, 1] = time
        self._middle = float(positions.along_m.mean())
        self._target = positions.along_m - self._middle
        self._contrasts()

    def _contrasts(self) -> None:
        """Independent contrasts free of s₀ and v₀: contrast k has variance noise + σ²_a · gain."""
        whiten = np.linalg.inv(np.linalg.cholesky(self._noise))
        design = self._start[: len(self.positions)]
        basis = np.linalg.qr(whiten @ design, mode="complete")[0][:, 2:]
        projected = basis.T @ whiten
        gain, vectors = np.linalg.eigh(projected @ self._of_along @ projected.T)
        self.gains = np.maximum(gain, 0.0)
        self.contrasts = vectors.T @ (projected @ self._target)

    def smooth(self, components: Components) -> Motion:
        """Posterior of the motion, given how strong acceleration and noise are."""
        n = len(self.positions)
        variance = components.acceleration_variance
        total = variance * self._of_along + components.noise_scale * self._noise
        cross = variance * self._with_along
        solved = np.linalg.solve(
            total, np.hstack([self._target[:, None], self._start[:n], cross[n:].T])
        )
        weighted, started = solved[:, 0], solved[:, 1:3]
        spread = np.linalg.inv(self._start[:n].T @ started)
        start = spread @ (self._start[:n].T @ weighted)
        mean = cross @ (weighted - started @ start) + self._start @ start
        left = self._start - cross @ started
        speed, acceleration = np.s_[n : 2 * n], np.s_[2 * n :]
        return Motion(
            self.positions.time_s,
            mean[:n] + self._middle,
            mean[speed],
            mean[acceleration],
            variance * self._of_speed
            - cross[speed] @ solved[:, 3 : 3 + n]
            + left[speed] @ spread @ left[speed].T,
            variance * self._of_acceleration
            - cross[acceleration] @ solved[:, 3 + n :]
            + left[acceleration] @ spread @ left[acceleration].T,
        )


def estimate_components(fits: Sequence[Fit]) -> Components:
    """Variance components by restricted maximum likelihood (Fisher scoring).

    A contrast of gain g is normal with variance noise + σ²_a g, so the squares regress on
    (1, g) with weights that the estimate itself gives. A weak prior stands in where vehicles are
    few.
    """
    gains = np.concatenate([fit.gains for fit in fits])
    squares = np.concatenate([fit.contrasts for fit in fits]) ** 2
    estimate = np.array([1.0, _LIKELY_ACCELERATION_VARIANCE])
    prior = _PRIOR_OBSERVATIONS / 2 * np.diag([1.0, 0.0])
    for _ in range(20):
        variance = estimate[0] + estimate[1] * gains
        # A box that jumped is no acceleration: what lies beyond 3 σ counts as 3 σ.
        seen = np.minimum(squares, 9.0 * variance)
        weight = 0.5 / variance**2
        design = np.column_stack([np.ones_like(gains), gains])
        normal = (design * weight[:, None]).T @ design + prior
        new = np.linalg.solve(normal, (design * weight[:, None]).T @ seen + prior @ [1.0, 0.0])
        new = np.clip(new, [0.05, _LEAST], [25.0, _MOST])
        if np.allclose(new, estimate, rtol=1e-3):
            break
        estimate = new
    return Components(float(estimate[1]), float(estimate[0]))


def _integrals(time_s: Array) -> tuple[Array, Array]:
    """Matrices (n, n) that take accelerations, linear between their times, to the gain in speed
    and in position since the first time.
    """
    n = len(time_s)
    dt = np.diff(time_s)[:, None]
    before, after = np.eye(n)[:-1], np.eye(n)[1:]
    nothing = np.zeros((1, n))
    to_speed = np.vstack([nothing, np.cumsum(dt / 2 * (before + after), axis=0)])
    moved = to_speed[:-1] * dt + dt**2 * (before / 3 + after / 6)
    return to_speed, np.vstack([nothing, np.cumsum(moved, axis=0)])
