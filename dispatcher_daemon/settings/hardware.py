"""Settings of a quantum device."""

from __future__ import annotations

from pydantic import Field

from slipstream.config import TunedSettings


class HardwareSettings(TunedSettings):
    """A quantum device beside the solvers: its jobs, budget and circuit breaker."""

    backend: str = Field(
        default="",
        pattern=r"^(|ibm:[A-Za-z0-9_-]+|fake:Fake[A-Za-z0-9]+)$",
        description="ibm:NAME, ibm:least-busy, or for a trial without an account fake:FakeBoston; "
        "empty: no device.",
    )
    shots: int = Field(default=4096, ge=1, le=100_000, description="Number of samples of a job.")
    budget_s_per_day: float = Field(
        default=60.0,
        gt=0,
        allow_inf_nan=False,
        description="Maximum device time in any 24 hours, s. A job's estimate is reserved before "
        "it is submitted.",
    )
    max_pending_jobs: int = Field(default=2, ge=1, le=100)
    """Maximum number of jobs at the service at once."""
    jobs_per_cycle: int = Field(default=1, ge=1, le=100)
    """Maximum number of jobs that one cycle submits."""
    wait_s: float = Field(
        default=3.0,
        ge=0,
        allow_inf_nan=False,
        description="How long a cycle waits for the device once all other solvers are done, s: in "
        "all its blocks together, and never into the last fifth of its deadline.",
    )
