"""What an installed laboratory (`lab/`) adds to the command; the product works without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from slipstream.errors import InputError
from slipstream.plugins import find_plugin

_PARTS: Final = "slipstream.laboratory"
_COMMANDS: Final = "slipstream.commands"
MEND: Final = "pip install ./lab in a checkout of Slipstream"


@cache
def commands() -> Mapping[str, EntryPoint]:
    """Sub-commands that installed packages add: what adds each to a parser, by name."""
    return {point.name: point for point in entry_points(group=_COMMANDS)}


def find_part(name: str) -> Callable[..., Any] | None:
    """A function that the laboratory gives to a command of the product; None: not installed.

    Raises:
        InputError: it is installed and cannot be loaded.
    """
    if not entry_points(group=_PARTS, name=name):
        return None
    built_in: Mapping[str, Callable[..., Any]] = {}
    return find_plugin(_PARTS, name, built_in, "part of the laboratory")


def part(name: str, asked: str) -> Callable[..., Any]:
    """As `find_part`, for what cannot be done without it.

    Args:
        asked: what the user asked for, for the message.

    Raises:
        InputError: the laboratory is not installed, or cannot be loaded.
    """
    found = find_part(name)
    if found is None:
        raise InputError(asked, "the laboratory is not installed", MEND)
    return found
