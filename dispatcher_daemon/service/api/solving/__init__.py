"""Fleets that callers have planned, in a process of their own."""

from dispatcher_daemon.service.api.solving.jobs import FullError, Job, JobState, SolveJobs

__all__ = ["FullError", "Job", "JobState", "SolveJobs"]
