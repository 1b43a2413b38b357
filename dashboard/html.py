"""Templates of HTML: every value is escaped, and a name that the context lacks is an error."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined


def templates(folder: Path, **filters: Callable[..., Any]) -> Environment:
    """The templates of a folder, with filters of their own and `shorten`."""
    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
    environment.filters |= {"shorten": shorten, **filters}
    return environment


def shorten(text: str, length: int = 80) -> str:
    """A text cut to a length in characters, with an ellipsis at the cut."""
    return text if len(text) <= length else text[: length - 1] + "…"
