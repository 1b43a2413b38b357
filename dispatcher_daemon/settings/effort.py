"""How much work the search and the circuits do, in three steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Literal, TypeVar

from slipstream.config import Settings

S = TypeVar("S", bound=Settings)
Effort = Literal["fast", "normal", "thorough"]

EFFORTS: Final[Mapping[Effort, Mapping[str, Any]]] = {
    "fast": {
        "city": {
            "search": {"rounds": 5, "iterations_per_stop": 8},
            "second_rounds": 1,
            "max_sweeps": 8,
            "patience": 2,
        },
        "lc_qaoa": {"layers": 1, "iterations": 20, "shots": 512},
    },
    "normal": {},
    "thorough": {
        "city": {
            "search": {"rounds": 45, "iterations_per_stop": 32},
            "second_rounds": 6,
            "max_sweeps": 60,
            "patience": 6,
        },
        "lc_qaoa": {"iterations": 300},
    },
}
"""By effort, what differs from the models' defaults."""


def with_effort(settings: S, values: Mapping[str, Any]) -> S:
    """Settings with some values, and those of inner tables, where they do not say them."""
    changes = {}
    for name, value in values.items():
        present = getattr(settings, name)
        if isinstance(value, Mapping):
            changes[name] = with_effort(present, value)
        elif name not in settings.model_fields_set:
            changes[name] = value
    return settings.model_copy(update=changes)
