"""Mean and variance over all vehicles and times of a window, with their standard errors."""

from __future__ import annotations

import numpy as np

from edge_daemon.camera import Array
from slipstream.messages import Estimate


def posterior_moments(
    weights: Array, means: Array, covariances: Array
) -> tuple[Estimate, Estimate]:
    """Mean and variance over all vehicles and times, each with its posterior standard error.

    With x̂ (v, n) the posterior means, P (v, n, n) their covariances and weights of sum 1, E[Σ w (x
    − x̄)²] is Σ w (x̂ − x̄)² + Σ w P_ii less the variance of x̄ itself.
    """
    mean = float(np.sum(weights * means))
    mean_variance = _quadratic(weights, covariances)
    off = means - mean
    diagonal = np.diagonal(covariances, axis1=1, axis2=2)
    value = float(np.sum(weights * (off**2 + diagonal))) - mean_variance
    error = 4 * _quadratic(weights * off, covariances) + 2 * _quadratic(weights, covariances**2)
    return (
        Estimate(value=mean, standard_error=float(np.sqrt(max(0.0, mean_variance)))),
        Estimate(value=max(0.0, value), standard_error=float(np.sqrt(max(0.0, error)))),
    )


def _quadratic(vectors: Array, matrices: Array) -> float:
    """Σ xᵀ M x over vectors (v, n) and matrices (v, n, n)."""
    return float(np.sum(vectors * (matrices @ vectors[:, :, None])[:, :, 0]))


def with_persistent_errors(
    weights: Array, mean: Estimate, variance: Estimate, own_std: float, common_std: float
) -> tuple[Estimate, Estimate]:
    """Add errors that persist along a trajectory: a vehicle's own and those common to all.

    A vehicle longer or higher than its class appears to change speed as it approaches. Such errors
    increase the spread between vehicles, which is subtracted from the variance, and do not average
    out over a vehicle's positions.
    """
    shares = weights.sum(axis=1)
    alike = float(shares @ shares)
    own = own_std**2
    excess = max(0.0, variance.value - (1 - alike) * own)
    of_mean = np.hypot(common_std, np.sqrt(alike * own))
    of_variance = np.sqrt(4 * excess * alike * own + 2 * alike * own**2)
    return (
        Estimate(
            value=mean.value,
            standard_error=float(np.hypot(mean.standard_error or 0.0, of_mean)),
        ),
        Estimate(
            value=excess,
            standard_error=float(np.hypot(variance.standard_error or 0.0, of_variance)),
        ),
    )
