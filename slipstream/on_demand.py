"""Names of a package that are loaded when they are asked for: of use where one process needs all of
a package and another one little of it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from importlib import import_module


def on_demand(package: str, names: Collection[str], modules: str) -> Callable[[str], object]:
    """The `__getattr__` of a package (PEP 562).

    Args:
        names: that the package exports.
        modules: where they are found, with spaces between, tried in this order: light ones first.
    """

    def find(name: str) -> object:
        for module in modules.split() if name in names else ():
            found = vars(import_module(f"{package}.{module}"))
            if name in found:
                return found[name]
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return find
