"""An instance of our own in the library's format, whose vehicles are full to the last unit."""

from __future__ import annotations

from pathlib import Path
from typing import Final

NAME: Final = "OWN-n12-k3-02"
OPTIMUM: Final = 588
"""As `test_cover` finds it by looking at all ways to cut the stops into three."""

_PLACES: Final = (
    *((83, 26), (10, 29), (41, 81), (45, 9), (33, 60), (81, 72), (99, 18)),
    *((88, 5), (55, 27), (20, 65), (30, 56), (26, 15), (74, 43)),
)
DEMANDS: Final = (60, 103, 73, 48, 29, 66, 94, 97, 88, 71, 44, 46)


def instance_text(name: str = NAME, capacity: int = 273) -> str:
    """Twelve stops and a depot, random."""
    at = [f"{i} {x} {y}" for i, (x, y) in enumerate(_PLACES, 1)]
    of = [f"{i} {demand}" for i, demand in enumerate((0, *DEMANDS), 1)]
    return "\n".join(
        [
            *(f"NAME : {name}", "TYPE : CVRP", f"DIMENSION : {len(_PLACES)}"),
            *("EDGE_WEIGHT_TYPE : EUC_2D", f"CAPACITY : {capacity}", "NODE_COORD_SECTION", *at),
            *("DEMAND_SECTION", *of, "DEPOT_SECTION", "1", "-1", "EOF"),
        ]
    )


def library(folder: Path, *, solution: bool = True) -> Path:
    """A folder as the library's, with the instance; returns the instance's file."""
    path = folder / "09-routing" / "instances" / f"{NAME}.vrp"
    path.parent.mkdir(parents=True)
    path.write_text(instance_text(), encoding="utf-8")
    if solution:
        beside = folder / "09-routing" / "solutions"
        beside.mkdir()
        (beside / f"{NAME}.opt.sol").write_text(f"Cost {OPTIMUM}\n", encoding="utf-8")
    return path
