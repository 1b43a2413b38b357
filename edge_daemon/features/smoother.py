"""The motion of vehicles along a segment from noisy positions: a Gaussian-process smoother.

Position is s(t) = s₀ + v₀ t + ∬ a, with the acceleration a Gaussian process of variance σ²_a and a
Matérn-3/2 correlation (Rasmussen & Williams, Gaussian Processes, 2006, eq. 4.17), around 0 or
around a mean that all vehicles share, s₀ and v₀ unknown (ibid., eq. 2.41). It is the smoother of a
Singer-like manoeuvre model (Singer, IEEE Trans. AES 6, 1970) over the whole window. How strong
accelerations and noise are is taken from the data, by the restricted likelihood of all vehicles of
the segment, so that calm traffic is smoothed hard and rough traffic is not flattened. Few vehicles
on a short way do not tell σ²_a: what is asked of accelerations is averaged over its posterior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array

BIN_S: Final = 0.2
"""Positions are averaged over so long before smoothing: little is lost, much time is won."""
MAX_BINS: Final = 24
"""A vehicle that is in view for long gets longer bins: smoothing costs the cube of their number."""
CORRELATION_S: Final = 2.5
"""Length scale of the acceleration's correlation."""
NOISE_CORRELATION_S: Final = 0.05
"""For so long most of a box's error stays: the detector sees nearly the same frame."""
SLOW_SHARE: Final = 0.6
"""Share of a box's error variance that stays for longer: the same side hidden, the same shape."""
SLOW_CORRELATION_S: Final = 1.0
_NOISE_OBSERVATIONS: Final = 10.0
"""For so many the stated noise counts."""
_STD_MPS2: Final = np.geomspace(0.04, 6.0, 20)
_MEDIAN_STD_MPS2: Final = 0.7
"""Of σ_a, before anything is seen: as likely calm as turbulent, by the paper's threshold."""
_NOISE_SCALES: Final = np.geomspace(0.1, 20.0, 25)
_CLIP: Final = 9.0
"""A box that jumped is no acceleration: a contrast speaks for no more than 3 σ."""
_UNLIKELY: Final = 1e-4


@dataclass(frozen=True)
class Positions:
    """Binned positions of one vehicle along the segment, in order of time, arrays (n,). The error
    has a part that is independent between positions, `variance_m2`, and one that neighbours share.
    """

    time_s: Array
    along_m: Array
    variance_m2: Array
    slow_m2: Array

    def __len__(self) -> int:
        return len(self.time_s)


def bin_positions(
    vehicle: npt.NDArray[np.intp], time_s: Array, along_m: Array, variance_m2: Array
) -> list[Positions]:
    """Average each vehicle's positions over bins, weighted by their certainty: one vehicle after
    the other.

    Boxes of neighbouring frames err alike, r(Δt) = exp(−Δt / NOISE_CORRELATION_S): each position
    counts for less, the closer the frames lie, by (1 + r)/(1 − r) for an AR(1) process. Arrays are
    (n,), ordered by vehicle, then time; `variance_m2` is of one position.
    """
    first = np.diff(vehicle, prepend=-1) != 0
    begins, of = np.flatnonzero(first), np.cumsum(first) - 1
    begin_s, end_s = time_s[begins], time_s[np.diff(vehicle, append=-1) != 0]
    alike = np.exp(-np.diff(time_s, prepend=-np.inf).clip(0) / NOISE_CORRELATION_S)
    alike[begins] = 0.0
    weight = (1 - alike) / (1 + alike) / variance_m2
    bin_s = np.maximum(BIN_S, (end_s - begin_s) / MAX_BINS)
    number = np.floor((time_s - begin_s[of]) / bin_s[of] + 1e-6)
    opens = first | (np.diff(number, prepend=-1) != 0)
    bins = np.cumsum(opens) - 1
    total = np.bincount(bins, weight)
    columns = (
        np.bincount(bins, weight * time_s) / total,
        np.bincount(bins, weight * along_m) / total,
        (1 - SLOW_SHARE) / total,
        SLOW_SHARE * np.bincount(bins, weight * variance_m2) / total,
    )
    borders = [*bins[begins].tolist(), len(total)]
    return [
        Positions(*(column[begin:end] for column in columns)) for begin, end in pairwise(borders)
    ]


@dataclass(frozen=True)
class VarianceComponents:
    """What the positions of a segment's vehicles vary by: the variance of the acceleration's
    process, (m/s²)², the positions' true variance over the stated one, and the process's mean.
    """

    acceleration_variance: float
    noise_scale: float
    mean_acceleration_mps2: float = 0.0


@dataclass(frozen=True)
class ComponentsPosterior:
    """Variance components that the data allow for, each with its probability, arrays (k,)."""

    weight: Array
    acceleration_variance: Array
    noise_scale: Array
    mean_acceleration_mps2: Array

    @property
    def mean(self) -> VarianceComponents:
        """The posterior mean of each."""
        return VarianceComponents(
            float(self.weight @ self.acceleration_variance),
            float(self.weight @ self.noise_scale),
            float(self.weight @ self.mean_acceleration_mps2),
        )


@dataclass(frozen=True)
class Motion:
    """Smoothed motion at n condensed positions of one vehicle, or of a stack of v vehicles.

    Covariances are (n, n). In a stack all arrays have a leading axis (v,), and n is the largest
    number of positions; what fills up the rows of vehicles with fewer means nothing.
    """

    time_s: Array
    along_m: Array
    speed_mps: Array
    acceleration_mps2: Array
    speed_covariance: Array
    acceleration_covariance: Array

    def of(self, vehicle: int, n: int) -> Motion:
        """One vehicle's motion at its n positions, from a stack."""
        return Motion(
            self.time_s[vehicle, :n],
            self.along_m[vehicle, :n],
            self.speed_mps[vehicle, :n],
            self.acceleration_mps2[vehicle, :n],
            self.speed_covariance[vehicle, :n, :n],
            self.acceleration_covariance[vehicle, :n, :n],
        )


class Smoother:
    """The positions of vehicles, three each and more, ready for estimating components and for
    smoothing.

    All vehicles stand in one stack, so that they cost a handful of array operations. The rows of
    vehicles with fewer positions are padded with uninformative observations: at their last time, of
    zero, with independent noise and no part in the motion.

    A vehicle's contrasts are independent combinations of its positions, free of s₀ and v₀: each has
    the variance noise + σ²_a · gain, and all that the positions say of accelerations is in them.
    """

    def __init__(self, positions: Sequence[Positions]) -> None:
        counts = np.array([len(each) for each in positions])
        n = int(counts.max())
        self._real = np.arange(n) < counts[:, None]
        rows = np.minimum(np.arange(n), counts[:, None] - 1) + (np.cumsum(counts) - counts)[:, None]

        def stack(name: str) -> Array:
            return np.asarray(np.concatenate([getattr(each, name) for each in positions])[rows])

        self._time_s = stack("time_s")
        time = self._time_s - self._time_s[:, :1]
        apart = np.abs(time[:, :, None] - time[:, None])
        to_speed, to_along = _integrals(time)
        to_along[~self._real] = 0.0
        distance = np.sqrt(3.0) * apart / CORRELATION_S
        correlation: Array = (1 + distance) * np.exp(-distance)
        # Covariances for σ²_a = 1: of position, speed and acceleration with position, of each.
        with_along = correlation @ to_along.mT
        self._of_along = to_along @ with_along
        self._with_along = np.concatenate(
            [self._of_along, to_speed @ with_along, with_along], axis=1
        )
        self._of_speed = to_speed @ correlation @ to_speed.mT
        self._of_acceleration = correlation
        slow = np.sqrt(np.where(self._real, stack("slow_m2"), 0.0))
        quick = np.where(self._real, stack("variance_m2"), 1.0)
        self._noise: Array = slow[:, :, None] * slow[:, None] * np.exp(-apart / SLOW_CORRELATION_S)
        self._noise += np.eye(n) * quick[:, None]
        # Effect of s₀ and v₀ on position, speed and acceleration.
        self._start = np.zeros((len(counts), 3 * n, 2))
        self._start[:, :n, 0] = self._real
        self._start[:, :n, 1] = np.where(self._real, time, 0.0)
        self._start[:, n : 2 * n, 1] = 1.0
        along = np.where(self._real, stack("along_m"), 0.0)
        self._middle = along.sum(axis=1, keepdims=True) / counts[:, None]
        self._target = np.where(self._real, along - self._middle, 0.0)
        self._way = np.where(self._real, time**2 / 2, 0.0)
        self._since_s = np.where(self._real, time, 0.0)
        self._find_contrasts(with_along)

    def _find_contrasts(self, with_along: Array) -> None:
        """Arrays (v, n − 2): gains, values, and values where all accelerate at 1 m/s²; and the
        covariance of accelerations with them for σ²_a = 1, (v, n, n − 2).
        """
        n = self._real.shape[1]
        whiten = np.linalg.inv(np.linalg.cholesky(self._noise))
        design = self._start[:, :n]
        basis = np.linalg.qr(whiten @ design, mode="complete")[0][:, :, 2:]
        projected = basis.mT @ whiten
        covariance = projected @ self._of_along @ projected.mT
        # Padding stays on separate axes, marked by a gain that no contrast can have.
        covariance -= np.eye(n - 2) * ~self._real[:, 2:, None]
        gain, vectors = np.linalg.eigh(covariance)
        both = vectors.mT @ (projected @ np.stack([self._target, self._way], axis=2))
        self._contrasted = gain > -0.5
        self._gain = np.where(self._contrasted, np.maximum(gain, 0.0), 0.0)
        self._contrast, self._accelerated = np.where(self._contrasted, np.moveaxis(both, 2, 0), 0.0)
        self._with_contrast = with_along @ projected.mT @ vectors * self._contrasted[:, None]

    def components(self) -> ComponentsPosterior:
        """Posterior of the variance components, on a grid of σ_a and of the noise's scale.

        σ_a has a half-Cauchy prior (Gelman, Bayesian Analysis 1, 2006), the noise's scale one of
        `_NOISE_OBSERVATIONS` at 1, the common mean acceleration the process's own variance, as a
        lone vehicle's is as likely its own. The noise's scale is averaged for each σ_a.
        """
        real = self._contrasted
        gain, value, common = self._gain[real], self._contrast[real], self._accelerated[real]
        variance = _STD_MPS2**2
        spread = _NOISE_SCALES[:, None] + variance[:, None, None] * gain
        precision = (common**2 / spread).sum(axis=2) + 1 / variance[:, None]
        mean = (common * value / spread).sum(axis=2) / precision
        squares = (value - mean[:, :, None] * common) ** 2 / spread
        likelihood = -0.5 * (
            np.log(spread).sum(axis=2)
            + np.minimum(squares, _CLIP).sum(axis=2)
            + mean**2 / variance[:, None]
            + np.log(precision * variance[:, None])
            + _NOISE_OBSERVATIONS * (np.log(_NOISE_SCALES) + 1 / _NOISE_SCALES)
        )
        prior = _STD_MPS2 / (1 + (_STD_MPS2 / _MEDIAN_STD_MPS2) ** 2)
        joint = np.exp(likelihood - likelihood.max()) * prior[:, None]
        joint /= joint.sum()
        weight = joint.sum(axis=1)
        kept = weight > _UNLIKELY
        joint, weight = joint[kept], weight[kept]
        return ComponentsPosterior(
            weight / weight.sum(),
            variance[kept],
            np.exp(joint @ np.log(_NOISE_SCALES) / weight),
            (joint * mean[kept]).sum(axis=1) / weight,
        )

    def accelerations(self, components: ComponentsPosterior) -> tuple[Array, Array]:
        """Posterior means (k, v, n) of the accelerations for each of k components, and their
        covariances (k, v, n, n).
        """
        variance = components.acceleration_variance[:, None, None]
        common = components.mean_acceleration_mps2[:, None, None]
        known = self._contrasted / (components.noise_scale[:, None, None] + variance * self._gain)
        left = known * (self._contrast - common * self._accelerated)
        mean = common + variance * (self._with_contrast @ left[..., None])[..., 0]
        explained = (self._with_contrast * known[:, :, None]) @ self._with_contrast.mT
        variance = variance[..., None]
        return mean, variance * self._of_acceleration - variance**2 * explained

    def smooth(self, components: VarianceComponents) -> Motion:
        """Posterior of the motions as a stack, given how strong acceleration and noise are."""
        n = self._real.shape[1]
        variance = components.acceleration_variance
        common = components.mean_acceleration_mps2
        target = self._target - common * self._way
        total = variance * self._of_along + components.noise_scale * self._noise
        cross = variance * self._with_along
        design = self._start[:, :n]
        solved = np.linalg.solve(
            total, np.concatenate([target[:, :, None], design, cross[:, n:].mT], axis=2)
        )
        weighted, started = solved[:, :, :1], solved[:, :, 1:3]
        spread = np.linalg.inv(design.mT @ started)
        start = spread @ (design.mT @ weighted)
        mean = (cross @ (weighted - started @ start) + self._start @ start)[:, :, 0]
        left = self._start - cross @ started
        speed, acceleration = np.s_[:, n : 2 * n], np.s_[:, 2 * n :]
        return Motion(
            self._time_s,
            mean[:, :n] + self._middle + common * self._way,
            mean[speed] + common * self._since_s,
            mean[acceleration] + common,
            variance * self._of_speed
            - cross[speed] @ solved[:, :, 3 : 3 + n]
            + left[speed] @ spread @ left[speed].mT,
            variance * self._of_acceleration
            - cross[acceleration] @ solved[:, :, 3 + n :]
            + left[acceleration] @ spread @ left[acceleration].mT,
        )


def _integrals(time_s: Array) -> tuple[Array, Array]:
    """Matrices (v, n, n) that take accelerations, linear between their times (v, n), to the gain
    in speed and in position since the first time.
    """
    count, n = time_s.shape
    dt = np.diff(time_s)[:, :, None]
    before, after = np.eye(n)[:-1], np.eye(n)[1:]
    to_speed, to_along = np.zeros((2, count, n, n))
    np.cumsum(dt / 2 * (before + after), axis=1, out=to_speed[:, 1:])
    moved = to_speed[:, :-1] * dt + dt**2 * (before / 3 + after / 6)
    np.cumsum(moved, axis=1, out=to_along[:, 1:])
    return to_speed, to_along
