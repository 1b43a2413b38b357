"""What an installed laboratory (`lab/`) adds to the command; the product works without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Final

from slipstream.errors import InputError
from slipstream.service.logs import complain

MEND: Final = "pip install ./lab in a checkout of Slipstream"
_COMMANDS: Final = "slipstream.commands"
_PARTS: Final = "slipstream.laboratory"

Adder = Callable[..., Any]


def commands() -> Mapping[str, Adder]:
    """What adds each sub-command of installed packages to a parser, by name."""
    return _loaded()[_COMMANDS]


def find_part(name: str) -> Adder | None:
    """A function that the laboratory gives to a command of the product; None: there is none."""
    return _loaded()[_PARTS].get(name)


def part(name: str, asked: str) -> Adder:
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


@cache
def _loaded() -> Mapping[str, Mapping[str, Adder]]:
    """By group its entry points; one that cannot be loaded is told, and keeps no daemon from its
    start.
    """
    found: dict[str, dict[str, Adder]] = {}
    installed = entry_points()  # once: each look reads what all packages have
    for group in (_COMMANDS, _PARTS):
        of_group = found.setdefault(group, {})
        for point in installed.select(group=group):
            try:
                of_group[point.name] = point.load()
            except Exception as error:
                complain(f"slipstream {point.name}: {point.value} cannot be loaded: {error}")
    return found
