"""The Jinja2 environment of the page: autoescape, strict names, formatting filters.

Every value is escaped; templates cut texts that come from messages with ``shorten``.
"""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Final

from dashboard.html import templates
from dashboard.view import labels
from dashboard.view.labels import Rgb
from dashboard.view.model import platoon_km

MAX_ROWS: Final = 6
"""Troubles that the summary shows."""


def render(template: str, **context: object) -> str:
    """Render a template of the folder ``templates`` to HTML.

    Raises:
        jinja2.UndefinedError: the template uses a name that the context lacks.
    """
    return _ENVIRONMENT.get_template(template).render(context)


def number(value: float | None, spec: str) -> str:
    """A number by a format specification; a dash for None."""
    return "–" if value is None else format(value, spec)


def css(rgb: Rgb) -> str:
    """An sRGB colour as CSS writes it."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


_ENVIRONMENT: Final = templates(
    Path(__file__).parent / "templates",
    base64=_base64,
    css=css,
    duration=labels.duration,
    number=number,
    platoon_km=platoon_km,
    plural=labels.plural,
)
_ENVIRONMENT.globals |= {
    "LEVEL_RGB": labels.LEVEL_RGB,
    "LEVEL_SIGN": labels.LEVEL_SIGN,
    "MAX_ROWS": MAX_ROWS,
    "TRAFFIC_DASHES": labels.TRAFFIC_DASHES,
    "TRAFFIC_RGB": labels.TRAFFIC_RGB,
    "TRAFFIC_SIGN": labels.TRAFFIC_SIGN,
}
