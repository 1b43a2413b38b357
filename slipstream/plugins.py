"""Implementations by name: built-in ones, and those that installed packages add.

A package adds one by an entry point (Python packaging's term) whose group says what it is and whose
name is its name in settings. It is loaded only when it is asked for.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from importlib.metadata import entry_points
from typing import TypeVar

from slipstream.errors import InputError

T = TypeVar("T")


def plugin_names(group: str, built_in: Collection[str]) -> tuple[str, ...]:
    """All names: the built-in ones in their order, then those of installed packages."""
    added = {point.name for point in entry_points(group=group)}
    return (*built_in, *sorted(added.difference(built_in)))


def find_plugin(
    group: str, name: str, built_in: Mapping[str, T], kind: str, key: str | None = None
) -> T:
    """The implementation of that name.

    Args:
        group: of entry points.
        built_in: implementations by name; a package cannot replace them.
        kind: what it is, for messages: "solver".
        key: of the setting that names it, for messages.

    Raises:
        InputError: there is none, or the package that adds it cannot be loaded.
    """
    if name in built_in:
        return built_in[name]
    for point in entry_points(group=group, name=name):
        try:
            found: T = point.load()
        except Exception as error:
            problem = f"{point.value} cannot be loaded: {type(error).__name__}: {error}"
            mend = "install its package again, or remove it"
            raise InputError(f"{kind} {name}", problem, mend, key=key) from None
        return found
    raise InputError(
        f"{kind} {name}",
        f"there is no such {kind}",
        f"use one of: {', '.join(plugin_names(group, built_in))}",
        key=key,
    )
