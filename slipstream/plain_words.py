"""What is wrong with a value that a model refuses, in the words of who wrote it, and the mend."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

_Words = tuple[str, str]
_NUMBER: Final = ("is no number", "give a number")
_WHOLE: Final = ("is no whole number", "give a whole number")
_LIST: Final = ("is no list", "give a list")
_TABLE: Final = ("is no table", "give a table of keys")

_SAID: Final[Mapping[str, Callable[[Mapping[str, Any]], _Words]]] = {
    "greater_than_equal": lambda c: (f"is below {c['ge']}", f"give {c['ge']} or more"),
    "greater_than": lambda c: (f"is not above {c['gt']}", f"give more than {c['gt']}"),
    "less_than_equal": lambda c: (f"is above {c['le']}", f"give {c['le']} or less"),
    "less_than": lambda c: (f"is not below {c['lt']}", f"give less than {c['lt']}"),
    **dict.fromkeys(("float_type", "float_parsing", "finite_number"), lambda _: _NUMBER),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), lambda _: _WHOLE),
    **dict.fromkeys(("tuple_type", "list_type", "set_type"), lambda _: _LIST),
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), lambda _: _TABLE),
    "bool_type": lambda _: ("is neither true nor false", "give true or false"),
    "string_type": lambda _: ("is no text", "give a text in quotes"),
    "string_too_short": lambda c: (
        ("is empty", "give a text")
        if c["min_length"] == 1
        else (f"is shorter than {c['min_length']} characters", "give a longer one")
    ),
    "string_too_long": lambda c: (
        f"is longer than {c['max_length']} characters",
        "give a shorter one",
    ),
    "too_short": lambda c: (
        ("is empty", "give an entry")
        if c["min_length"] == 1
        else (f"has fewer than {c['min_length']} entries", "give more")
    ),
    "too_long": lambda c: (f"has more than {c['max_length']} entries", "give fewer"),
    "literal_error": lambda c: (f"is none of {c['expected']}", "give one of them"),
}
"""By pydantic's type of error: the problem after the value, and the mend."""


def words_of(kind: str, context: Mapping[str, Any], value: str) -> _Words | None:
    """Problem and mend of an error; None: its own message is the best.

    Args:
        kind: pydantic's type of error.
        context: of it.
        value: that is wrong, as it may be shown; "": it may not.
    """
    said = _SAID.get(kind)
    if said is None:
        return None
    bounds = {k: f"{v:g}" if isinstance(v, float) else v for k, v in context.items()}
    problem, mend = said(bounds)
    return f"{value or 'it'} {problem}", mend
