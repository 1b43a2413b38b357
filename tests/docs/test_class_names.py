"""One name, one class."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PRODUCT = (
    *("dashboard", "dispatcher_daemon", "edge_daemon", "slipstream", "slipstream_cli"),
    *("storage", "vehicle_agent"),
)


@pytest.mark.slow
def test_no_class_name_occurs_twice_in_the_product() -> None:
    """In none of its packages, classes inside of functions included."""
    names = Counter(
        node.name
        for package in PRODUCT
        for path in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in names.items() if count > 1] == []
