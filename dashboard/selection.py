"""What a browser has selected, and how it stands in a URL.

A page opens the 3D view with ``/?select=van/van-17``. viser's page connects its websocket to the
path that it came from and knows no other parameter, so the request is answered with a redirect to a
path that names the selection, and the handshake of the websocket names it again.
"""

from __future__ import annotations

from contextvars import ContextVar
from dataclasses import dataclass
from typing import Final, Literal, get_args
from urllib.parse import parse_qs, quote, unquote, urlsplit

Kind = Literal["van", "road", "rsu"]

KINDS: Final[tuple[str, ...]] = get_args(Kind)
MAX_ID_LENGTH: Final = 200
_PREFIX: Final = "/select/"


@dataclass(frozen=True)
class Selection:
    """A vehicle, a road or an RSU."""

    kind: Kind
    id: str

    def path(self) -> str:
        """The path that names it, without a character that a browser writes in another way."""
        # viser's page copies its path into a parameter and back, where %23 becomes a #.
        name = quote(self.id, safe="").replace("~", "%7E").replace("%", "~")
        return f"{_PREFIX}{self.kind}/{name}"

    def fragment(self) -> str:
        """As the operator's page writes it behind its ``#``."""
        return f"{self.kind}/{quote(self.id, safe='')}"


asked_for: Final[ContextVar[Selection | None]] = ContextVar("asked_for", default=None)
"""The selection that a connection's path names, in the tasks of that connection."""


def of_path(target: str) -> Selection | None:
    """The selection of a path as `Selection.path` writes it; None for any other path."""
    path = target.partition("?")[0]
    if not path.startswith(_PREFIX):
        return None
    kind, _, name = path.removeprefix(_PREFIX).partition("/")
    return _checked(kind, name.replace("~", "%"))


def of_query(target: str) -> Selection | None:
    """The selection of a request's ``?select=kind/id``; None without one, or for a bad one."""
    if len(target) > 8 * MAX_ID_LENGTH:
        return None
    try:
        values = parse_qs(urlsplit(target).query, max_num_fields=8).get("select", [])
    except ValueError:
        return None
    kind, _, name = values[0].partition("/") if len(values) == 1 else ("", "", "")
    return _checked(kind, quote(name, safe=""))


def _checked(kind: str, quoted: str) -> Selection | None:
    if kind not in KINDS or len(quoted) > 6 * MAX_ID_LENGTH:
        return None
    try:
        name = unquote(quoted, errors="strict")
    except UnicodeDecodeError:
        return None
    if not 0 < len(name) <= MAX_ID_LENGTH or not name.isprintable():
        return None
    return Selection(_KIND_OF[kind], name)


_KIND_OF: Final[dict[str, Kind]] = {kind: kind for kind in get_args(Kind)}
