"""What the commands that import a map have in common: options, and what is told of the import."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from slipstream_lab.simulation.scenarios.networks import Import

_MAX_WARNINGS: Final = 10
_MAX_CHARACTERS: Final = 200


def add_map_options(command: argparse.ArgumentParser) -> None:
    """Add ``--driving-side`` and ``--country``."""
    command.add_argument(
        "--driving-side",
        choices=("left", "right"),
        help="of the map's roads (default: as the map says, or else by where it lies)",
    )
    command.add_argument(
        "--country",
        type=_country,
        metavar="XX",
        help="ISO 3166-1 code, such as AT: its side, and its limits where none is signed (default: "
        "as the map says)",
    )


def _country(text: str) -> str:
    if not re.fullmatch("[A-Za-z]{2}", text):
        raise argparse.ArgumentTypeError(f"{text!r} is no code of two letters, such as AT")
    return text.upper()


def extract_name(extract: Path) -> str:
    """The name of a net made of an extract."""
    return extract.name.partition(".")[0] or "net"


def assumptions(found: Import) -> Iterator[str]:
    """What an import took where the map says nothing, and netconvert's warnings, by line."""
    yield f"driven on the {found.side.side}: {found.side.why}"
    if found.assumed:
        law = "most countries'" if found.country is None else f"{found.country}'s"
        km = sum(found.assumed.values())
        yield f"{_km(km)} km of roads without a signed limit, by {law} law (--country):"
        for (kmh, why), length in found.assumed.items():
            yield f"  {_km(length):>7} km taken as {kmh:g} km/h: {why}"
    if found.warnings:
        yield "netconvert warns:"
        for text, count in list(found.warnings.items())[:_MAX_WARNINGS]:
            short = text if len(text) <= _MAX_CHARACTERS else text[: _MAX_CHARACTERS - 3] + "..."
            yield f"  {count:7} {short}"
        more = len(found.warnings) - _MAX_WARNINGS
        if more > 0:
            yield f"  and {more} further kinds: --json has them all"


def _km(km: float) -> str:
    return f"{km:.2f}" if km < 1 else f"{km:.1f}"
