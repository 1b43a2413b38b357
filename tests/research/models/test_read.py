"""Models of all formats: each has the energies that its own definition gives."""

from __future__ import annotations

import gzip
import json
import lzma
from pathlib import Path

import dimod
import numpy as np
import pytest

from dispatcher_daemon.formulations import build_model
from dispatcher_daemon.formulations.files import WRITERS
from research.instances import open_instance
from research.instances.forms import arc_form_of
from research.models import MilpModel, QuboFile, read_model, solve_milp_model
from slipstream.errors import InputError

QS = "# ObjectiveOffset 9\n# Vars Non-zeros\n2 3\n1 1 -6\n2 2 -5\n1 2 2\n"
"""9 − 6a − 5b + 4ab: 9, 3, 4, 2."""
OF_STATES = {(): 9.0, (0,): 3.0, (1,): 4.0, (0, 1): 2.0}
MILP = "max\n obj: x + 2 y + z\nst\n c: x + y + z <= 2\nbounds\n z <= 5\ngeneral\n x y\nend\n"


def written(folder: Path, name: str, data: str | bytes) -> Path:
    """The path of a new file."""
    path = folder / name
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def qubo(path: Path) -> QuboFile:
    """A model that has to be a QUBO."""
    model = read_model(path)
    assert isinstance(model, QuboFile)
    return model


def as_dimod() -> dimod.BinaryQuadraticModel:
    """The same two variables as spins."""
    bqm = dimod.BinaryQuadraticModel({"a": -6, "b": -5}, {("a", "b"): 4}, 9, "BINARY")
    return bqm.change_vartype("SPIN", inplace=False)


def as_bytes(bqm: dimod.BinaryQuadraticModel) -> bytes:
    """dimod's own file."""
    with bqm.to_file() as file:
        return bytes(file.read())


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.qs", QS),
        ("a.qs.xz", lzma.compress(QS.encode())),
        ("a.qs.gz", gzip.compress(QS.encode())),
        ("a.coo", "# vartype=BINARY offset=9\n0 0 -6\n1 1 -5\n0 1 4\n"),
        ("a.coo", "# vartype=SPIN offset=4.5\n0 0 -2\n1 1 -1.5\n0 1 1\n"),
        ("a.bqm", as_bytes(as_dimod())),
        ("a.json", json.dumps(as_dimod().to_serializable())),
        ("a.lp", "min\n obj: -6 a - 5 b + [ 8 a * b ] / 2 + 9\nst\nbinary\n a b\nend\n"),
        ("a.lp", "max\n obj: 6 a + 5 b + [ - 8 a * b ] / 2 - 9\nst\nbinary\n a b\nend\n"),
    ],
    ids=["qs", "xz", "gz", "coo", "spins", "bqm", "json", "lp", "lp-max"],
)
def test_each_format_is_the_same_model(name: str, data: str | bytes, tmp_path: Path) -> None:
    """Every state has its value; of a maximised model the negative one."""
    model = qubo(written(tmp_path, name, data))
    sign = -1 if model.scale < 0 else 1
    assert {s: sign * model.objective(s) for s in OF_STATES} == pytest.approx(OF_STATES)


@pytest.mark.parametrize("ending", [".qs", ".coo", ".json"])
def test_what_we_write_we_read(ending: str, tmp_path: Path) -> None:
    """A published instance's QUBO has the same energy in random states."""
    model = build_model(arc_form_of(open_instance("arc14-avenue")).problem)
    path = tmp_path / f"a{ending}"
    WRITERS[ending](model, path)
    back = qubo(path)
    assert len(back.problem.names) == len(model.variables)
    order = list(range(len(model.variables)))
    if ending == ".json":  # dimod keeps names, not their order
        order = [back.problem.names.index(str(variable)) for variable in model.variables]
    states = np.random.default_rng(3).integers(0, 2, size=(20, len(model.variables)))
    energies = model.total.energies((states, list(model.variables)))
    found = [back.objective([order[i] for i in np.flatnonzero(state)]) for state in states]
    assert found == pytest.approx(energies, rel=1e-9)


def test_a_milp_is_solved_with_its_bound(tmp_path: Path) -> None:
    """Two units of the dearer integer; a maximised model keeps its sign."""
    model = read_model(written(tmp_path, "a.lp", MILP))
    assert isinstance(model, MilpModel)
    answer = solve_milp_model(model, 10.0, 1)
    assert (answer.status, answer.objective, answer.bound) == ("optimal", 4.0, 4.0)
    assert answer.values == {"y": 2.0}


@pytest.mark.parametrize(
    ("name", "data", "problem"),
    [
        ("a.txt", QS, "no such kind of model file"),
        ("a.qs", QS.rpartition("1 2")[0], "1 entries are missing"),
        ("a.qs", QS + "1 2 2\n", "line 7: more entries than stated"),
        ("a.qs", QS.replace("1 2 2", "1 3 2"), "line 6: a variable that is not from 1 to 2"),
        ("a.qs", QS.replace("-6", "nan"), "line 4: 'nan' is not a number"),
        ("a.qs.xz", b"abc", "cannot be unpacked"),
        ("a.coo", "0 0\n", "line 1: not 'i j bias'"),
        ("a.coo", "", "no variable"),
        ("a.json", "[1]", "a.json"),
        ("a.bqm", b"abc", "a.bqm"),
        ("a.lp", "hello", "HiGHS cannot read it"),
        ("a.lp", MILP.replace("z\nst", "z + [ x * y ]\nst"), "a quadratic objective and"),
    ],
    ids=[
        *("ending", "cut", "more", "index", "nan", "xz", "coo", "empty", "json", "bqm"),
        *("lp", "quadratic"),
    ],
)
def test_a_faulty_model_is_one_line(
    name: str, data: str | bytes, problem: str, tmp_path: Path
) -> None:
    """Whatever is wrong, with the file's name."""
    path = written(tmp_path, name, data)
    with pytest.raises(InputError) as caught:
        read_model(path)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_bytes_end_in_anything_but_a_model_or_one_line(tmp_path: Path) -> None:
    """Files of all formats with bytes changed at random."""
    rng = np.random.default_rng(5)
    seeds: dict[str, bytes] = {
        "a.qs": QS.encode(),
        "a.coo": b"# vartype=BINARY offset=9\n0 0 -6\n1 1 -5\n0 1 4\n",
        "a.bqm": as_bytes(as_dimod()),
        "a.json": json.dumps(as_dimod().to_serializable()).encode(),
    }
    refused = 0
    for name, data in seeds.items():
        for _ in range(60):
            changed = bytearray(data)
            for at in rng.integers(0, len(data), size=3):
                changed[at] = rng.integers(0, 256)
            try:
                read_model(written(tmp_path, name, bytes(changed)))
            except InputError:
                refused += 1
    assert refused > 0
