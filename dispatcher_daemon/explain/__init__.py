"""A stored cycle in words, for people and with the figures for programs."""

from __future__ import annotations

from dispatcher_daemon.explain.explanation import Explanation, as_text, explanation
from dispatcher_daemon.explain.words import refusal_line

__all__ = ["Explanation", "as_text", "explanation", "refusal_line"]
