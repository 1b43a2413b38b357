"""Mean and variance over all vehicles and times of a window, with their standard errors.

Functions take arrays with leading axes, for several posteriors at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from scipy.special import gammainc

from edge_daemon.camera import Array
from slipstream.messages import Estimate

_SURE: Final = 1e-6
"""A variance whose standard deviation is a smaller share of it is known; so is one that is as small
a share of a limit."""


class Moments(NamedTuple):
    """Mean and variance over vehicles and times, and the standard error of each."""

    mean: Array
    mean_error: Array
    variance: Array
    variance_error: Array


def posterior_moments(weights: Array, means: Array, covariances: Array) -> Moments:
    """Mean and variance over all vehicles and times, each with its posterior standard error.

    With x̂ (…, v, n) the posterior means, P (…, v, n, n) their covariances and weights (v, n) of sum
    1, E[Σ w (x − x̄)²] is Σ w (x̂ − x̄)² + Σ w P_ii less the variance of x̄ itself.
    """
    mean = np.sum(weights * means, axis=(-2, -1))
    mean_variance = _quadratic(weights, covariances)
    off = means - mean[..., None, None]
    diagonal = np.diagonal(covariances, axis1=-2, axis2=-1)
    value = np.sum(weights * (off**2 + diagonal), axis=(-2, -1)) - mean_variance
    error = 4 * _quadratic(weights * off, covariances) + 2 * _quadratic(weights, covariances**2)
    return Moments(
        mean,
        np.sqrt(np.maximum(0.0, mean_variance)),
        np.maximum(0.0, value),
        np.sqrt(np.maximum(0.0, error)),
    )


def _quadratic(vectors: Array, matrices: Array) -> Array:
    """Σ xᵀ M x over vectors (…, v, n) and matrices (…, v, n, n)."""
    return np.asarray(np.sum(vectors * (matrices @ vectors[..., None])[..., 0], axis=(-2, -1)))


def with_persistent_errors(
    weights: Array, moments: Moments, own_std: float, common_std: float
) -> Moments:
    """Add errors that persist along a trajectory: a vehicle's own and those common to all.

    A vehicle longer or higher than its class appears to change speed as it approaches. Such errors
    increase the spread between vehicles, which is subtracted from the variance, and do not average
    out over a vehicle's positions.
    """
    shares = weights.sum(axis=1)
    alike = float(shares @ shares)
    own = own_std**2
    excess = np.maximum(0.0, moments.variance - (1 - alike) * own)
    of_mean = np.hypot(common_std, np.sqrt(alike * own))
    of_variance = np.sqrt(4 * excess * alike * own + 2 * alike * own**2)
    return Moments(
        moments.mean,
        np.hypot(moments.mean_error, of_mean),
        excess,
        np.hypot(moments.variance_error, of_variance),
    )


@dataclass(frozen=True)
class VariancePosterior:
    """What a variance may be: a mixture of gamma distributions, arrays (k,)."""

    weight: Array
    mean: Array
    std: Array

    @classmethod
    def of(cls, estimate: Estimate) -> Self:
        """One gamma distribution of an estimate's value and standard error, which it has."""
        return cls(
            np.ones(1), np.array([estimate.value]), np.array([estimate.standard_error or 0.0])
        )

    @property
    def estimate(self) -> Estimate:
        """Its mean and standard deviation."""
        value = float(self.weight @ self.mean)
        second = float(self.weight @ (self.std**2 + self.mean**2))
        return Estimate(value=value, standard_error=float(np.sqrt(max(0.0, second - value**2))))

    def corrected(self, estimate: Estimate) -> VariancePosterior:
        """The same, scaled to another mean, and as much wider as its standard error asks for."""
        own = self.estimate
        scale = estimate.value / own.value if own.value > 0 else 1.0
        error, before = estimate.standard_error or 0.0, scale * (own.standard_error or 0.0)
        more = np.sqrt(max(0.0, error**2 - before**2))
        return VariancePosterior(self.weight, self.mean * scale, np.hypot(self.std * scale, more))

    def below(self, limit: float) -> float:
        """Probability that the variance is a limit at most."""
        sure = (self.std <= _SURE * self.mean) | (self.mean <= _SURE * limit)
        mean, std = np.where(sure, 1.0, self.mean), np.where(sure, 1.0, self.std)
        shape = (mean / std) ** 2
        chance = np.where(sure, self.mean <= limit, gammainc(shape, shape * limit / mean))
        return min(1.0, float(self.weight @ chance))  # weights may sum to a little more
