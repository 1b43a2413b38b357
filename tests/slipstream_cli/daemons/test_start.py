from __future__ import annotations

import json
import subprocess
import sys

import pytest

LOADED = """
import importlib, json, sys
for module in sys.argv[1:]:
    importlib.import_module(module)
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""
LATE = {"fastapi", "viser"}
"""Loaded while reports come in: they take as long as all before."""
OTHERS = {"alembic", "cv2", "jinja2", "openvino", "osmium", "qiskit", "qiskit_aer", "torch"}
"""Of workers, other daemons, rare commands and pages that a browser asks for."""


@pytest.mark.process
@pytest.mark.long
@pytest.mark.parametrize(
    ("daemon", "late"),
    [
        ("dispatcher_daemon.service.daemon", LATE | {"dimod", "uvicorn"}),
        ("dashboard.daemon", LATE | {"scipy", "networkx", "dispatcher_daemon"}),
    ],
)
def test_a_daemon_hears_before_it_loads_what_can_wait(daemon: str, late: set[str]) -> None:
    """What it loads before its reports come in keeps it from them after each restart."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED, "slipstream_cli.main", daemon],
        capture_output=True,
        check=True,
    )
    assert not (late | OTHERS | {"slipstream_lab"}) & set(json.loads(done.stdout))
