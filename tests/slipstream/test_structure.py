"""The structure that the design promises."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
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


_LOADED_LATE = {
    # entries of processes
    "dispatcher_daemon.service.daemon",
    "dispatcher_daemon.solvers.cluster.members",
    # HiGHS, the database
    "dispatcher_daemon.forms.files",
    "dispatcher_daemon.forms.milp",
    "dispatcher_daemon.service.store",
}
"""Modules that others import by name, because not every process that needs their package may load
them."""
_IMPORT = re.compile(
    r"^ *from ((?:dispatcher_daemon|vehicle_agent)[.\w]*) import (\([^)]*\)|.+)$", re.MULTILINE
)


@pytest.mark.slow
def test_nobody_reaches_past_a_room() -> None:
    """From outside a room of the dispatcher or the agent, imports name a package, which exports
    what others use, and no module in it. Inside, no module takes a name from a package that it
    lies in: the package imports its modules.
    """
    past, back = [], []
    for importer, source, names in _imports():
        for name in names:
            target = f"{source}.{name}" if _is_module(source, name) else source
            room = ".".join(target.split(".")[:2])
            if f"{importer}.".startswith(f"{room}."):
                back += [f"{importer}: {source}"] * importer.startswith(f"{target}.")
            elif target.count(".") > 1 and _file(target).with_suffix(".py").is_file():
                past += [f"{importer}: {target}"] * (target not in _LOADED_LATE)
    assert not past
    assert not back


def _imports() -> Iterator[tuple[str, str, list[str]]]:
    """Of each import from the dispatcher or the agent: who imports, from where, which names."""
    for file in ROOT.glob("[!.]*/**/*.py"):
        parts = file.relative_to(ROOT).with_suffix("").parts
        if "tests" not in parts:
            importer = ".".join(parts).removesuffix(".__init__")
            for source, names in _IMPORT.findall(file.read_text()):
                listed = re.sub(r"#.*", "", names).strip("()").split(",")
                yield importer, source, [name.split()[0] for name in listed if name.strip()]


def _file(name: str) -> Path:
    return ROOT.joinpath(*name.split("."))


def _is_module(package: str, name: str) -> bool:
    """Whether what is imported is a module; a package may export a name that a module has too."""
    file = _file(f"{package}.{name}")
    if not (file.is_dir() or file.with_suffix(".py").is_file()):
        return False
    return f'"{name}"' not in file.with_name("__init__.py").read_text()


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


@pytest.mark.long
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
