"""Fleets that callers have planned, in a process of their own."""

from dispatcher_daemon.service.api.solving.jobs import FullError, JobState, SolveJob, SolveJobs

__all__ = ["FullError", "JobState", "SolveJob", "SolveJobs"]
