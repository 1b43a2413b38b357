"""A road network of any size, as a SUMO net."""

from __future__ import annotations

from pathlib import Path


def write_grid(path: Path, size: int) -> list[str]:
    """Write a SUMO net of ``size`` × ``size`` junctions, streets both ways; returns segment ids."""
    nodes = [(x, y) for x in range(size) for y in range(size)]
    ways = [
        ((x, y), (x + dx, y + dy))
        for x, y in nodes
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))
        if (x + dx, y + dy) in set(nodes)
    ]

    def name(node: tuple[int, int]) -> str:
        return f"{node[0]}.{node[1]}"

    lines = [
        '<net version="1.16"><location netOffset="0,0" convBoundary="0,0,2000,2000" '
        'origBoundary="0,0,2000,2000" projParameter="!"/>'
    ]
    for a, b in ways:
        shape = f"{100 * a[0]},{100 * a[1]} {100 * b[0]},{100 * b[1]}"
        lines.append(
            f'<edge id="{name(a)}-{name(b)}" from="{name(a)}" to="{name(b)}" priority="1">'
            f'<lane id="{name(a)}-{name(b)}_0" index="0" speed="13.89" length="100" '
            f'shape="{shape}"/></edge>'
        )
    for x, y in nodes:
        arriving = " ".join(f"{name(a)}-{name(b)}_0" for a, b in ways if b == (x, y))
        lines.append(
            f'<junction id="{x}.{y}" type="priority" x="{100 * x}" y="{100 * y}" '
            f'incLanes="{arriving}" intLanes="" shape="{100 * x},{100 * y}"/>'
        )
    lines += [
        f'<connection from="{name(a)}-{name(b)}" to="{name(b)}-{name(d)}" fromLane="0" toLane="0" '
        'dir="s" state="M"/>'
        for a, b in ways
        for c, d in ways
        if c == b and d != a
    ]
    path.write_text("\n".join([*lines, "</net>"]))
    return [f"{name(a)}-{name(b)}" for a, b in ways]
