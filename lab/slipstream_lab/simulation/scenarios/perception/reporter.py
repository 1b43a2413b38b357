"""Simulated RSU reports: true windows with the measured errors of the perception.

The errors come from windows of rendered clips whose truth is known (`make bench-accuracy`), apart
for calm and turbulent ones: a bias and a spread a feature, and how the six errors go together.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import numpy.typing as npt
from pydantic import Field

from edge_daemon.features.stability import StabilityJudge
from edge_daemon.settings import StabilitySettings
from slipstream.config import Settings, check, read_data
from slipstream.errors import InputError
from slipstream.messages import Estimate, KinematicFeatures, SegmentState
from slipstream_lab.simulation.ground_truth import TrueWindow
from slipstream_lab.simulation.scenarios.perception.observer import Observation

FEATURES: Final = (
    "mean_speed_mps",
    "mean_acceleration_mps2",
    "density_veh_per_m",
    "speed_std_mps",
    "acceleration_variance_m2ps4",
    "mean_gap_m",
)
RELATIVE: Final = ("mean_speed_mps", "density_veh_per_m", "mean_gap_m")
"""Features whose errors are shares of the true value; the others' are in the feature's unit."""

_SIGNED: Final = "mean_acceleration_mps2"
_MIN_WINDOWS: Final = 30
_FPS: Final = 30.0

Finite = Annotated[float, Field(allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class FeatureError(Settings):
    """Error of one feature, estimate less truth."""

    bias: Finite
    std: NonNegative
    standard_error: NonNegative = Field(description="What the perception says it is, on average.")


class RegimeErrors(Settings):
    """Errors in windows of one kind."""

    windows: Annotated[int, Field(ge=1)] = Field(description="How many were measured.")
    features: dict[str, FeatureError]
    correlation: tuple[tuple[Finite, ...], ...] = Field(description="Between the features' errors.")


class PerceptionErrors(Settings):
    """The error model."""

    provenance: str
    calm: RegimeErrors
    turbulent: RegimeErrors
    lost_share: Annotated[float, Field(ge=0, le=1)] = Field(
        description="Of windows with vehicles, those that nothing was measured in."
    )


def measured_errors(path: Path | None = None) -> PerceptionErrors:
    """The errors as they were measured on the shipped detector, or another file of them. Raises
    InputError: the file is malformed.
    """
    path = path or Path(
        str(resources.files("slipstream_lab.simulation.scenarios") / "data" / "perception.json")
    )
    errors = check(read_data(path), PerceptionErrors, path)
    for key, regime in (("calm", errors.calm), ("turbulent", errors.turbulent)):
        matrix = np.array(regime.correlation, dtype=np.float64, ndmin=2)
        square = matrix.shape == (len(FEATURES), len(FEATURES))
        if set(regime.features) != set(FEATURES) or not square:
            raise InputError(path, "not the six features", "measure it again", key=key)
    return errors


def fit_errors(
    windows: Sequence[tuple[SegmentState, TrueWindow]], provenance: str
) -> PerceptionErrors:
    """Fit the error model to states and the true windows beside them. Raises InputError: too few
    windows of a kind.
    """
    seen = [(state, true) for state, true in windows if state.features is not None]
    regimes = []
    for y_e, key in ((1, "calm"), (0, "turbulent")):
        own = [(s, t) for s, t in seen if t.y_e == y_e]
        if len(own) < _MIN_WINDOWS:
            problem = f"{len(own)} {key} windows are too few"
            raise InputError(provenance, problem, f"measure at least {_MIN_WINDOWS}")
        regimes.append(_fit(own))
    lost = 1 - len(seen) / len(windows)
    return PerceptionErrors(
        provenance=provenance, calm=regimes[0], turbulent=regimes[1], lost_share=lost
    )


def write_errors(errors: PerceptionErrors, path: Path) -> None:
    """Write an error model as JSON, rounded to what the measurement carries."""
    data = json.loads(
        errors.model_dump_json(), parse_float=lambda text: float(f"{float(text):.4g}")
    )
    path.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


def _fit(windows: Sequence[tuple[SegmentState, TrueWindow]]) -> RegimeErrors:
    errors = np.full((len(windows), len(FEATURES)), np.nan)
    said = np.full_like(errors, np.nan)
    for row, (state, true) in enumerate(windows):
        for column, name in enumerate(FEATURES):
            estimate, value = getattr(state.features, name), getattr(true, name)
            if estimate is None or value is None:
                continue
            scale = max(abs(value), 1e-6) if name in RELATIVE else 1.0
            errors[row, column] = (estimate.value - value) / scale
            if estimate.standard_error is not None:
                said[row, column] = estimate.standard_error / scale
    whole = errors[np.isfinite(errors).all(axis=1)]
    off = whole - whole.mean(axis=0)
    size = np.sqrt(np.square(off).sum(axis=0))
    # A feature whose error never changes goes with no other's.
    unit = off / np.where(size > 0, size, 1.0)
    correlation = np.where(np.eye(len(FEATURES)) == 1, 1.0, unit.T @ unit)
    return RegimeErrors(
        windows=len(windows),
        features={
            name: FeatureError(
                bias=float(np.nanmean(errors[:, i])),
                std=float(np.nanstd(errors[:, i])),
                standard_error=float(np.nanmean(said[:, i])),
            )
            for i, name in enumerate(FEATURES)
        },
        correlation=tuple(tuple(row) for row in correlation.tolist()),
    )


class Reporter:
    """Turns true windows into SegmentStates as RSUs would send them.

    Errors are drawn anew for each RSU, segment and time from the seed, whatever was asked before.

    Args:
        errors: the model; None: none, the truth itself with standard errors of 0.
        keep_s: how long which RSUs keep a flag, as of `StabilitySettings`; the others not at all.
        noise: the paper's, on top: each feature times 1 + noise · N(0, 1).
    """

    def __init__(
        self,
        errors: PerceptionErrors | None,
        seed: int,
        *,
        keep_s: Mapping[str, float] | None = None,
        noise: float = 0.0,
        window_s: float = 10.0,
        midnight_ns: int = 0,
    ) -> None:
        if noise < 0:
            raise ValueError(f"noise must be >= 0, got {noise}")
        self._errors = errors
        self._seed = seed
        self._keep_s = keep_s or {}
        self._judges: dict[str, StabilityJudge] = {}
        self._noise = noise
        self._window_s = window_s
        self._midnight_ns = midnight_ns
        self._sequence = 0

    def report(self, observation: Observation) -> SegmentState:
        """The state that an RSU sends of a window; a judge takes the windows in this order."""
        rsu, segment = observation.rsu, observation.segment
        place = zlib.crc32(f"{rsu}\n{segment}".encode())
        stream = [self._seed, place, round(observation.time_s * 1000)]
        rng = np.random.default_rng(stream)
        features = self._features(observation.truth, rng)
        vehicles = (
            0 if features is None or observation.truth is None else observation.truth.vehicles
        )
        frames = round(self._window_s * _FPS)
        time_ns = self._midnight_ns + round(observation.time_s * 1e9)
        flag = self._judge(rsu).judge(segment, time_ns, features, vehicles, frames, 1.0)
        self._sequence += 1
        return SegmentState(
            rsu=rsu,
            segment=segment,
            sequence=self._sequence,
            time_ns=time_ns,
            window_s=self._window_s,
            features=features,
            y_e=flag.y_e,
            reason=flag.reason,
            vehicles=vehicles,
            frames=frames,
            coverage=1.0,
            p_stable=flag.p_stable,
        )

    def _judge(self, rsu: str) -> StabilityJudge:
        if rsu not in self._judges:
            settings = StabilitySettings(keep_s=self._keep_s.get(rsu, 0.0))
            self._judges[rsu] = StabilityJudge(settings)
        return self._judges[rsu]

    def _features(
        self, truth: TrueWindow | None, rng: np.random.Generator
    ) -> KinematicFeatures | None:
        if truth is None:
            return None
        # Drawn always, so that one kind of error does not change the other's numbers.
        lost, error, noise = rng.random(), rng.normal(size=len(FEATURES)), rng.normal(size=6)
        errors = self._errors
        if errors is not None and lost < errors.lost_share:
            return None
        values = [getattr(truth, name) for name in FEATURES]
        said = [0.0] * len(FEATURES)
        if errors is not None:
            regime = errors.calm if truth.y_e == 1 else errors.turbulent
            error = _root(regime) @ error
            for i, name in enumerate(FEATURES):
                if values[i] is None:
                    continue
                model = regime.features[name]
                scale = abs(values[i]) if name in RELATIVE else 1.0
                values[i] += (model.bias + model.std * error[i]) * scale
                said[i] = model.standard_error * scale
        made = {}
        for i, name in enumerate(FEATURES):
            value = values[i]
            if value is not None:
                value *= 1 + self._noise * float(noise[i])
                value = value if name == _SIGNED else max(0.0, value)
                value = Estimate(value=float(value), standard_error=said[i])
            made[name] = value
        return KinematicFeatures(**made)


def _root(regime: RegimeErrors) -> npt.NDArray[np.float64]:
    """A matrix R with R Rᵀ the correlation; rounding may have left it slightly indefinite."""
    values, vectors = np.linalg.eigh(np.array(regime.correlation))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
