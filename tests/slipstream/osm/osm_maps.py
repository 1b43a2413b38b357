"""OpenStreetMap extracts written by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

Tags = Mapping[str, str]


def tagged(tags: Tags) -> str:
    """Tags as XML."""
    return "".join(f"<tag k={quoteattr(k)} v={quoteattr(v)}/>" for k, v in tags.items())


def write(
    path: Path,
    nodes: Mapping[int, tuple[float, float]],
    ways: Mapping[int, tuple[Sequence[int], Tags]],
    relations: Sequence[tuple[Sequence[tuple[str, int, str]], Tags]] = (),
    signals: Sequence[int] = (),
) -> Path:
    """Write an extract: nodes by latitude and longitude, ways by nodes and tags, relations by
    members (kind, id, role) and tags; some nodes have signals.
    """
    text = "".join(
        f'<node id="{n}" lat="{lat:.7f}" lon="{lon:.7f}" version="1">'
        f"{tagged({'highway': 'traffic_signals'}) if n in signals else ''}</node>"
        for n, (lat, lon) in nodes.items()
    )
    for number, (refs, tags) in ways.items():
        inner = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        text += f'<way id="{number}" version="1">{inner}{tagged(tags)}</way>'
    for number, (members, tags) in enumerate(relations, start=1):
        inner = "".join(f'<member type="{k}" ref="{n}" role="{r}"/>' for k, n, r in members)
        text += f'<relation id="{number}" version="1">{inner}{tagged(tags)}</relation>'
    path.write_text(f'<osm version="0.6">{text}</osm>', encoding="utf-8")
    return path


def town(
    path: Path,
    at: tuple[float, float] = (48.2, 16.3),
    tags: Mapping[str, Tags] | None = None,
    more: Tags | None = None,
) -> Path:
    """A grid of three by three junctions 300 m apart: main streets "m1" to "m3" from west to east,
    side streets "s1" to "s3" from south to north, a signal in the middle.

    Args:
        at: the south-west corner.
        tags: of streets by name, instead of the usual ones, or beside them.
        more: of all streets.
    """
    step = 0.0027
    nodes = {
        10 * i + j + 1: (at[0] + step * i, (at[1] + step * j + 180) % 360 - 180)
        for i in range(3)
        for j in range(3)
    }
    given = tags or {}
    ways: dict[int, tuple[Sequence[int], Tags]] = {}
    for k in range(3):
        main, side = [10 * k + j + 1 for j in range(3)], [10 * i + k + 1 for i in range(3)]
        for name, refs, road in (
            (f"m{k + 1}", main, "primary"),
            (f"s{k + 1}", side, "residential"),
        ):
            number = (100 if name[0] == "m" else 200) + k
            usual = {"highway": road, "name": name, **(more or {})}
            ways[number] = refs, {**usual, **given.get(name, {})}
    return write(path, nodes, ways, signals=[12])
