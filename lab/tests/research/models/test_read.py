"""Models of all formats: each has the energies that its own definition gives."""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
from itertools import product
from pathlib import Path

import dimod
import numpy as np
import pytest

from dispatcher_daemon.forms import build_model
from slipstream.errors import InputError
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.forms import arc_form_of
from slipstream_lab.research.models import MilpModel, QuboFile, read_model, solve_milp_model
from slipstream_lab.research.models.write import WRITERS

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
        ("a.coo", "\ufeff# vartype: binary\r\n0 0 -6\r\n1 1 -5\r\n0 1 4\r\n# offset: 9\r\n"),
        (
            "A.COO.GZ",
            gzip.compress(b"# vartype=BINARY offset=9\n0 0 -6\n")
            + gzip.compress(b"1 1 -5\n0 1 4\n"),
        ),
        ("A.QS.BZ2", bz2.compress(QS.encode())),
        ("a.qs.coo", "# vartype=BINARY offset=9\n0 0 -6\n1 1 -5\n0 1 4\n"),
        ("a.bqm", as_bytes(as_dimod())),
        ("a.json", json.dumps(as_dimod().to_serializable())),
        ("a.lp", "min\n obj: -6 a - 5 b + [ 8 a * b ] / 2 + 9\nst\nbinary\n a b\nend\n"),
        ("a.lp", "max\n obj: 6 a + 5 b + [ - 8 a * b ] / 2 - 9\nst\nbinary\n a b\nend\n"),
        (
            "a.mps.LP",
            "\ufeffmin\r\n obj: -6 a - 5 b + [ 8 a * b ] / 2 + 9\r\nbinary\r\n a b\r\nend",
        ),
        ("a.JSON", "\ufeff" + json.dumps(as_dimod().to_serializable(), indent=1)),
    ],
    ids=[
        *("qs", "xz", "gz", "coo", "spins", "windows", "members", "bz2", "two-endings", "bqm"),
        *("json", "lp", "lp-max", "lp-windows", "json-mark"),
    ],
)
def test_each_format_is_the_same_model(name: str, data: str | bytes, tmp_path: Path) -> None:
    """Every state has its value; of a maximised model the negative one."""
    model = qubo(written(tmp_path, name, data))
    sign = -1 if model.scale < 0 else 1
    assert {s: sign * model.objective(s) for s in OF_STATES} == pytest.approx(OF_STATES)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.sparse", "# by hand\n4 6\n1 1 {a}\n2 2 -3\n1 2 {b}\n4 2 {c}\n3 4 -1.5\n4 4 1\n"),
        ("a.BQ", "4 6\r\n1 1 {a}\r\n2 2 -3\r\n1 2 {b}\r\n4 2 {c}\r\n3 4 -1.5\r\n4 4 1\r\n"),
    ],
)
def test_biq_mac_minimises_a_symmetric_matrix(name: str, text: str, tmp_path: Path) -> None:
    """Every state of four variables has the value of x'Qx, Q's other half being the same."""
    a, b, c = 2.0, -4.0, 3.5
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1], matrix[3, 3] = a, -3.0, 1.0
    for i, j, value in ((0, 1, b), (3, 1, c), (2, 3, -1.5)):
        matrix[i, j] = matrix[j, i] = value
    model = qubo(written(tmp_path, name, text.format(a=a, b=b, c=c)))
    assert model.scale > 0
    assert model.problem.names == ("1", "2", "3", "4")
    for state in product((0, 1), repeat=4):
        x = np.array(state)
        assert model.objective(np.flatnonzero(x).tolist()) == pytest.approx(float(x @ matrix @ x))


@pytest.mark.parametrize("name", ["a.mc", "a.rud", "A.RUDY.GZ"])
def test_a_graph_is_cut_where_it_weighs_most(name: str, tmp_path: Path) -> None:
    """Every state has the weight of the edges between its ones and its zeros, to be maximised."""
    text = "4 5\n1 2 3\n3 2 -1\n3 4 2\n4 1 5\n1 3 1.5\n"
    edges = {(0, 1): 3, (1, 2): -1, (2, 3): 2, (0, 3): 5, (0, 2): 1.5}
    packed = name.endswith("GZ")
    model = qubo(written(tmp_path, name, gzip.compress(text.encode()) if packed else text))
    assert model.scale < 0
    for x in product((0, 1), repeat=4):
        cut = sum(weight for (i, j), weight in edges.items() if x[i] != x[j])
        assert model.objective([i for i in range(4) if x[i]]) == pytest.approx(cut)


def test_qbsolv_counts_each_coupler_once(tmp_path: Path) -> None:
    """Nodes from 0 on, of which some are not used; every state has the value of its entries."""
    text = (
        "c sample\np  qubo  0  9  3  3\nc ---\n0 0 3.4\n2 2 -4.5\n5 5 2\n0 2 2.2\n0 5 -3\n2 5 1\n"
    )
    model = qubo(written(tmp_path, "a.QUBO", text))
    assert (model.problem.names, model.scale > 0) == (("0", "2", "5"), True)
    for a, b, c in product((0, 1), repeat=3):
        value = 3.4 * a - 4.5 * b + 2 * c + 2.2 * a * b - 3 * a * c + b * c
        ones = [i for i, x in enumerate((a, b, c)) if x]
        assert model.objective(ones) == pytest.approx(value)


def test_the_type_of_coordinates_is_given_or_refused(tmp_path: Path) -> None:
    """Bits and spins have other minima; what the file says is not overruled."""
    silent = written(tmp_path, "a.coo", "0 1 1\n0 0 0.5\n")
    with pytest.raises(InputError, match=r"a\.coo: does not say whether .*; give --vartype"):
        read_model(silent)
    least = {}
    for kind in ("BINARY", "SPIN"):
        model = read_model(silent, kind)  # type: ignore[arg-type]
        assert isinstance(model, QuboFile)
        least[kind] = min(model.objective(s) for s in OF_STATES)
    assert least == {"BINARY": 0.0, "SPIN": pytest.approx(-1.5)}
    spins = written(tmp_path, "b.coo", "# vartype=SPIN\n0 1 1\n")
    assert read_model(spins, "SPIN")
    with pytest.raises(InputError, match=r"--vartype: .*b\.coo says its variables are SPIN"):
        read_model(spins, "BINARY")
    with pytest.raises(InputError, match=r"--vartype: only for \.coo"):
        read_model(written(tmp_path, "a.qs", QS), "BINARY")


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
    assert (model.warnings, answer.warnings) == ((), ())


@pytest.mark.parametrize(
    ("name", "text", "warnings"),
    [
        (
            "a.lp",
            "min\n obj: x\nst\n c: x + y >= -5\nbounds\n x <= -1\nend\n",
            ("x has inconsistent bounds: from 0 to -1",),
        ),
        (
            "a.mps",
            "NAME t\nROWS\n N cost\n N other\n L c1\nCOLUMNS\n MARKER 'MARKER' 'INTORG'\n"
            " x cost -1 c1 1\n MARKER 'MARKER' 'INTEND'\n y other 5 c1 1\n"
            "RHS\n r c1 4\n r2 c1 9\nBOUNDS\n UP b y 3\nENDATA\n",
            (
                'Row name "c1" in RHS section has duplicate value 9: ignored',
                "RHS section: ignored 0 undefined rows and 1 duplicate values",
                "of 2 free rows the first, cost, is the objective",
                "integers without bounds are taken as 0 or 1, as is usual in MPS: x",
            ),
        ),
        # HiGHS itself writes bytes that are no text about this one.
        (
            "b.mps",
            "NAME t\nROWS\n N cost\n L c1\nCOLUMNS\n x cost 1 c1 1\n x c9 4\n"
            "RHS\n r c1 4\nENDATA\n",
            ("Free format reader has detected row/col names with spaces",),
        ),
    ],
    ids=["bounds", "mps", "fixed"],
)
def test_what_is_odd_about_a_file_is_told(
    name: str,
    text: str,
    warnings: tuple[str, ...],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """HiGHS's own words and what it takes for granted, and nothing on standard output."""
    model = read_model(written(tmp_path, name, text))
    assert isinstance(model, MilpModel)
    assert all(any(w in found for found in model.warnings) for w in warnings)
    solve_milp_model(model, 5.0, 1)
    assert capfd.readouterr() == ("", "")


def test_unbounded_is_not_infeasible(tmp_path: Path) -> None:
    """HiGHS's presolve alone does not tell them apart."""
    free = "max\n obj: x + y\nst\n c: x - y <= 3\ngeneral\n x\nend\n"
    none = free.replace("general", " d: x + y <= -1\ngeneral")
    for text, status in ((free, "unbounded"), (none, "infeasible")):
        model = read_model(written(tmp_path, "a.lp", text))
        assert isinstance(model, MilpModel)
        assert solve_milp_model(model, 5.0, 1).status == status


@pytest.mark.parametrize(
    ("name", "data", "problem"),
    [
        ("a.txt", QS, "no such kind of model file"),
        ("a.qs", QS.rpartition("1 2")[0], "1 entries are missing"),
        ("a.qs", QS + "1 2 2\n", "line 7: more entries than stated"),
        ("a.qs", QS.replace("1 2 2", "1 3 2"), "line 6: a variable that is not from 1 to 2"),
        ("a.qs", QS.replace("-6", "nan"), "line 4: 'nan' is not a number"),
        ("a.qs.xz", b"abc", "cannot be unpacked"),
        ("a.qs.gz", gzip.compress(QS.encode())[:-9], "cannot be unpacked"),
        ("a.qs", QS.replace("2 2 -5", "2 1 -5"), "line 6: entry 1 2 twice"),
        ("a.coo", "0 0\n", "line 1: not 'i j value'"),
        ("a.coo", "# vartype=SPIN\n", "no variable"),
        ("a.coo", "0 0 1\n# vartype=SPIN\n# vartype=BINARY\n", "of type BINARY, and SPIN before"),
        (
            "a.coo",
            "# vartype=BINARY\n0 0 1\n".encode("utf-16"),
            "a.coo: not text: encoded in UTF-16",
        ),
        (
            "a.coo",
            "# vartype=BINARY\n# Gr\u00f6\u00dfe\n".encode("latin-1"),
            "line 2: not text: not UTF-8",
        ),
        ("a.sparse", "1\n2 1\n1 1 3\n", "as in OR-Library, where they are maximised"),
        ("a.mc", "2 1\n1 1 3\n", "line 2: an edge from a vertex to itself"),
        ("a.mc", "2 2\n1 2 3\n2 1 3\n", "line 3: entry 2 1 twice"),
        ("a.qubo", "MINIMIZE\n0 0 1\n", "line 1: no line 'p qubo"),
        ("a.qubo", "p qubo 0 2 1 1\n0 0 1\n1 0 1\n", "line 3: a pair that is not i <= j < 2"),
        ("a.qubo", "p qubo 0 2 2 0\n0 0 1\n", "1 nodes fewer than stated"),
        ("a.json", "[1]", "a.json"),
        ("a.bqm", b"abc", "a.bqm"),
        ("a.lp", "hello", "HiGHS cannot read it"),
        ("a.lp", MILP.replace("z\nst", "z + [ x * y ]\nst"), "a quadratic objective and"),
    ],
    ids=[
        *(
            "ending",
            "cut",
            "more",
            "index",
            "nan",
            "xz",
            "cut-gz",
            "twice",
            "coo",
            "empty",
            "types",
        ),
        *("utf-16", "latin-1", "or-library", "loop", "both", "other-qubo", "order", "nodes"),
        *("json", "bqm"),
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
        "a.qubo": b"p qubo 0 2 2 1\n0 0 -6\n1 1 -5\n0 1 4\n",
        "a.sparse": b"# x\n2 3\n1 1 -6\n2 2 -5\n1 2 2\n",
        "a.mc": b"3 3\n1 2 4\n2 3 1\n1 3 2\n",
        "a.lp": MILP.encode(),
        "a.mps": b"ROWS\n N c\n L r\nCOLUMNS\n x c 1 r 1\nRHS\n b r 4\nBOUNDS\n UP d x 3\nENDATA\n",
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
