"""Which instances are published: name, recipe and seed of each."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from slipstream_lab.research.instances.generator import Recipe

_TWO: Final = (True, True)

_OF_25: Final = (
    # Platooning changes the optimal routes.
    Recipe("avenue", _TWO, 2, "open", meet="stops", flips=True),
    Recipe("avenue", _TWO, 2, "mixed", meet="stops", flips=True),
    Recipe("avenue", _TWO, 2, "open", meet="depot", flips=True),
    Recipe("blocks", _TWO, 2, "open", meet="stops", flips=True),
    Recipe("ring", _TWO, 2, "open", meet="stops", flips=True),
    Recipe("ring", _TWO, 2, "mixed", meet="stops", flips=True),
    Recipe("bridges", _TWO, 2, "open", meet="stops", flips=True),
    Recipe("bridges", _TWO, 2, "mixed", meet="stops", flips=True),
    Recipe("motorway", _TWO, 2, "open", meet="stops", flips=True),
    Recipe("motorway", _TWO, 2, "mixed", meet="stops", flips=True),
    Recipe("motorway", _TWO, 2, "open", meet="stops", flips=True),
    Recipe("valley", _TWO, 2, "open", meet="stops", flips=True),
    # It does not, though there are rewards.
    Recipe("avenue", _TWO, 2, "mixed", meet="depot", flips=False),
    Recipe("blocks", _TWO, 2, "mixed", meet="stops", flips=False),
    Recipe("ring", _TWO, 2, "open", meet="depot", flips=False),
    Recipe("bridges", _TWO, 2, "open", meet="depot", flips=False),
    Recipe("valley", _TWO, 2, "mixed", meet="stops", flips=False),
    # There can be none: turbulent everywhere, or minutes apart.
    Recipe("motorway", _TWO, 2, "closed"),
    Recipe("blocks", _TWO, 2, "closed"),
    Recipe("valley", _TWO, 2, "open", ready_within_s=600.0),
)

_SMALL: Final = (
    ("arc06-valley", Recipe("valley", (True,), 1)),
    ("arc08-blocks", Recipe("blocks", (False,), 2)),
    ("arc14-motorway", Recipe("motorway", (True, True), 1)),
    ("arc14-bridges", Recipe("bridges", (True, True), 1, "mixed", meet="stops")),
    ("arc14-avenue", Recipe("avenue", (False, False), 2)),
    ("arc15-ring", Recipe("ring", (True,), 2, "mixed")),
    ("arc20-avenue", Recipe("avenue", (True, False), 2)),
    ("arc20-motorway", Recipe("motorway", (True, True, True), 1)),
)

_SEED: Final = 25

CATALOGUE: Final[Mapping[str, tuple[Recipe, int]]] = MappingProxyType(
    {
        **{name: (recipe, number) for number, (name, recipe) in enumerate(_SMALL)},
        **{
            f"arc25-{number:02d}-{recipe.landscape}": (recipe, 100 * _SEED + number)
            for number, recipe in enumerate(_OF_25, start=1)
        },
    }
)
"""Recipe and seed by name; the number behind ``arc`` is that of the QUBO's variables."""
