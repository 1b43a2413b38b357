"""Refusals of the API: problem documents, for a database that cannot be read too."""

from __future__ import annotations

from fastapi import FastAPI

from slipstream.http import problems
from slipstream.http.problems import (
    FAULT,
    MEDIA_TYPE,
    PROBLEM_RESPONSES,
    Problem,
    ProblemDocument,
    from_input_error,
)
from storage import StorageError

__all__ = [
    "FAULT",
    "MEDIA_TYPE",
    "PROBLEM_RESPONSES",
    "Problem",
    "ProblemDocument",
    "from_input_error",
    "handle_problems",
]


def handle_problems(app: FastAPI) -> None:
    """Have the API answer its refusals, and the framework's, as problem documents."""
    problems.handle_problems(app, paths="docs/api.md", unavailable=(StorageError,))
