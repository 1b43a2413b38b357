"""The structure that the design promises."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def test_imports_point_one_way() -> None:
    """The contracts in pyproject.toml hold: no arrow runs back up, no circle."""
    result = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_exactly_one_opencv_and_no_torch_are_installed() -> None:
    """Two OpenCV distributions would overwrite each other; torch would not fit an RSU."""
    if not sys.prefix.startswith(str(ROOT)):
        pytest.skip("not the project's own environment")
    names = {d.metadata["Name"].lower().replace("_", "-") for d in distributions()}
    assert [n for n in sorted(names) if n.startswith("opencv")] == ["opencv-python-headless"]
    assert "torch" not in names


def test_the_extras_that_the_design_names_exist() -> None:
    """Each role can be installed alone."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    wanted = {"edge", "dispatcher", "dashboard", "iskay", "cplex", "cluster"}
    assert wanted | {"postgres", "parquet", "osm", "tracing", "dev"} == set(extras)
    assert not any("torch" in d or "ultralytics" in d for d in extras["edge"])


@pytest.mark.slow(long=True)
@pytest.mark.process
def test_an_rsu_needs_no_dispatcher() -> None:
    """The edge daemon loads without the dispatcher's, the dashboard's and torch's packages."""
    code = (
        "import sys\n"
        "class Absent:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] in {'torch', 'ultralytics', 'qiskit', 'sqlalchemy', 'viser',"
        " 'apscheduler', 'dimod', 'storage', 'dispatcher_daemon', 'dashboard', 'slipstream_lab'}:\n"
        "            raise ModuleNotFoundError(name)\n"
        "sys.meta_path.insert(0, Absent())\n"
        "import edge_daemon.daemon, edge_daemon.sources.camera, edge_daemon.sources.clip\n"
        "import edge_daemon.detection.openvino, slipstream_cli.main\n"
        "slipstream_cli.main.parser()\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr


def test_the_make_targets_and_the_ci_run_the_same_tests() -> None:
    """CI runs the command that the README names."""
    assert re.search(r"^\s*make test$", (ROOT / ".ci" / "run").read_text(), re.MULTILINE)
    assert "make test" in (ROOT / "README.md").read_text()
