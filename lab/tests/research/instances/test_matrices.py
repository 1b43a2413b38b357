from __future__ import annotations

import json
import math
import re
import tempfile
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.settings import SearchSettings
from slipstream.config import read_data
from slipstream.errors import InputError
from slipstream_cli.main import main
from slipstream_lab.research.instances.matrices import (
    matrix_instance_from,
    read_published,
    search_matrix_instance,
    write_matrix_instance,
)

VRP = """NAME : corners-n5-k2
TYPE : CVRP
DIMENSION : 5
EDGE_WEIGHT_TYPE : EUC_2D
CAPACITY : 2
NODE_COORD_SECTION
1 0 0
2 10 10
3 10 11
4 -10 -10
5 -10 -11
DEMAND_SECTION
1 0
2 1
3 1
4 1
5 1
DEPOT_SECTION
1
-1
EOF
"""
LIMITED = f"DISTANCE : 90\nSERVICE_TIME : 3\n{VRP}".replace("EUC_2D", "GEO")
SOLOMON = """corners

VEHICLE
NUMBER     CAPACITY
  3         2

CUSTOMER
CUST NO.  XCOORD.   YCOORD.    DEMAND   READY TIME  DUE DATE   SERVICE   TIME

    0      0          0          0          0       200          0
    1      10         10         1         30        40         10
    2      10         11         1          0        20         10
    3      -10        -10        1          0       200         10
    4      -10        -11        1          0       200         10
"""


def written(folder: Path, name: str, text: str) -> Path:
    """A file of a set."""
    path = folder / name
    path.write_text(text)
    return path


def plain() -> dict[str, Any]:
    """Two stops on explicit matrices, whose shortest way is not the one of least energy."""
    return {
        "format": "slipstream-instance/1",
        "name": "two",
        "fleet": {
            "depots": [{"id": "yard", "node": "a"}],
            "stops": [{"id": s, "node": s, "service_s": 5.0} for s in ("b", "c")],
            "vehicles": [{"id": "v"}],
        },
        "matrix": {
            "places": [{"id": name} for name in "abc"],
            "distances_m": [[0, 1, 5], [5, 0, 1], [1, 5, 0]],
            "energy_kwh": [[0, 9, 1], [1, 0, 9], [9, 1, 0]],
        },
    }


def test_what_is_minimised_is_what_the_file_says() -> None:
    """Energy where it is given; the file's word where it has one."""
    for measure, order in (("distance", ("b", "c")), (None, ("c", "b"))):
        data = plain()
        if measure is not None:
            data["matrix"]["minimise"] = measure
        instance = matrix_instance_from(data, "two.json")
        with ThreadPoolExecutor(1) as executor:
            plan = search_matrix_instance(instance, SearchSettings(rounds=1), executor, 1)
        assert plan.routes["v"] == order
        assert plan.sums[instance.minimise] == 3
        assert (plan.unserved, plan.faults) == ((), ())


@pytest.mark.parametrize(
    ("name", "no"), [("distances_m", None), ("durations_s", 2.0**31 - 1), ("energy_kwh", 2**32 - 1)]
)
def test_no_way_is_driven_where_a_matrix_has_none(name: str, no: float | None) -> None:
    """Whichever matrix it is missing in: the stop is not served, and the others are."""
    data = plain()
    data["matrix"]["durations_s"] = [[0, 1, 5], [5, 0, 1], [1, 5, 0]]
    for i in range(3):
        data["matrix"][name][2][i] = data["matrix"][name][i][2] = no
    instance = matrix_instance_from(data, "two.json")
    with ThreadPoolExecutor(1) as executor:
        plan = search_matrix_instance(instance, SearchSettings(rounds=1), executor, 1)
    assert (plan.routes["v"], plan.unserved, plan.faults) == (("b",), ("c",), ())
    assert dict(plan.sums) == {"distance": 6, "duration": 6, "energy": 10}


def test_an_explicit_matrix_of_a_published_set_may_miss_ways(tmp_path: Path) -> None:
    """Its largest number means that no way leads between these two stops."""
    text = VRP.replace("EUC_2D", "EXPLICIT\nEDGE_WEIGHT_FORMAT : LOWER_ROW")
    text = text.replace("EOF", "EDGE_WEIGHT_SECTION\n1 2 3\n4 5 6 7 8 9 2147483647\nEOF")
    instance = read_published(written(tmp_path, "e.vrp", text), "vrplib")
    assert instance.measures["distance"][4].tolist() == [7, 8, 9, math.inf, 0]
    with ThreadPoolExecutor(1) as executor:
        plan = search_matrix_instance(instance, SearchSettings(rounds=1), executor, 1)
    assert (plan.unserved, plan.faults) == ((), ())
    assert math.isfinite(plan.sums["distance"])


def test_the_sets_distances_are_rounded_as_they_say(tmp_path: Path) -> None:
    """√200 and √221: to whole numbers in VRPLIB's files, cut to tenths in Solomon's; read back
    from the instance file they are the same.
    """
    cvrp = read_published(written(tmp_path, "corners.vrp", VRP), "vrplib")
    assert cvrp.measures["distance"][0].tolist() == [0, 14, 15, 14, 15]
    assert not cvrp.measures["duration"].any()
    assert len(cvrp.fleet.vehicles) == 4
    solomon = read_published(written(tmp_path, "corners.txt", SOLOMON), "solomon")
    assert solomon.measures["duration"][0].tolist() == [0, 14.1, 14.8, 14.1, 14.8]
    assert solomon.fleet.vehicles[0].return_by_s == 200
    write_matrix_instance(solomon, tmp_path / "out" / "corners.json")
    assert (
        matrix_instance_from(
            read_data(tmp_path / "out" / "corners.json"), tmp_path / "out" / "corners.json"
        )
        == solomon
    )


def test_an_explicit_matrix_is_read_from_its_lower_half(tmp_path: Path) -> None:
    """Row by row, however its lines are broken."""
    text = VRP.replace("EUC_2D", "EXPLICIT\nEDGE_WEIGHT_FORMAT : LOWER_ROW")
    text = text.replace("EOF", "EDGE_WEIGHT_SECTION\n1 2 3\n4 5 6 7\n8 9 10\nEOF")
    rows = read_published(written(tmp_path, "e.vrp", text), "vrplib").measures["distance"]
    assert rows.tolist()[4] == [7, 8, 9, 10, 0]
    assert (rows == rows.T).all()


@pytest.mark.parametrize(
    ("form", "numbers"),
    [
        ("LOWER_ROW", "1 2 3 4 5 6 7 8 9 10"),
        ("UPPER_COL", "1 2 3 4 5 6 7 8 9 10"),
        ("UPPER_ROW", "1 2 4 7 3 5 8 6 9 10"),
        ("LOWER_COL", "1 2 4 7 3 5 8 6 9 10"),
        ("LOWER_DIAG_ROW", "0 1 0 2 3 0 4 5 6 0 7 8 9 10 0"),
        ("UPPER_DIAG_COL", "0 1 0 2 3 0 4 5 6 0 7 8 9 10 0"),
        ("UPPER_DIAG_ROW", "0 1 2 4 7 0 3 5 8 0 6 9 0 10 0"),
        ("LOWER_DIAG_COL", "0 1 2 4 7 0 3 5 8 0 6 9 0 10 0"),
        ("FULL_MATRIX", "99 1 2 4 7 1 99 3 5 8 2 3 99 6 9 4 5 6 99 10 7 8 9 10 99"),
    ],
)
def test_every_part_of_a_matrix_is_the_whole(form: str, numbers: str, tmp_path: Path) -> None:
    """TSPLIB's formats give the same matrix, in one line as in many."""
    text = VRP.replace(
        "EUC_2D", f"EXPLICIT\nEDGE_WEIGHT_FORMAT: {form}\nDISPLAY_DATA_TYPE: TWOD_DISPLAY"
    )
    shown = "DISPLAY_DATA_SECTION\n1 3.5 4\n"
    text = text.replace("EOF", f"EDGE_WEIGHT_SECTION\n{numbers}\n{shown}")
    rows = read_published(written(tmp_path, "e.vrp", text), "vrplib").measures["distance"]
    assert rows.tolist() == [
        [0, 1, 2, 4, 7],
        [1, 0, 3, 5, 8],
        [2, 3, 0, 6, 9],
        [4, 5, 6, 0, 10],
        [7, 8, 9, 10, 0],
    ]


def test_an_asymmetric_matrix_keeps_its_directions(tmp_path: Path) -> None:
    """ACVRP: rows are from, columns to."""
    text = VRP.replace("TYPE : CVRP", "TYPE : ACVRP")
    text = text.replace("EUC_2D", "EXPLICIT\nEDGE_WEIGHT_FORMAT : FULL_MATRIX")
    numbers = " ".join(str(0 if i == j else 10 * i + j) for i in range(5) for j in range(5))
    text = text.replace("EOF", f"EDGE_WEIGHT_SECTION\n{numbers}")
    rows = read_published(written(tmp_path, "e.vrp", text), "vrplib").measures["distance"]
    assert (rows[1, 3], rows[3, 1]) == (13, 31)


@pytest.mark.parametrize(
    ("kind", "first", "second"),
    [
        ("CEIL_2D", 15, 15),
        ("FLOOR_2D", 14, 14),
        ("MAN_2D", 20, 21),
        ("MAX_2D", 10, 11),
        ("ATT", 5, 5),
    ],
)
def test_distances_are_those_of_tsplib(kind: str, first: int, second: int, tmp_path: Path) -> None:
    """From (0, 0) to (10, 10) and (10, 11), by each definition."""
    path = written(tmp_path, "e.vrp", VRP.replace("EUC_2D", kind))
    rows = read_published(path, "vrplib").measures["distance"]
    assert rows[0].tolist() == [0, first, second, first, second]
    assert (rows == rows.T).all()


def test_geo_is_tsplibs_earth(tmp_path: Path) -> None:
    """The known optimal tour of burma14 has its known length."""
    places = (
        *("16.47 96.10", "16.47 94.44", "20.09 92.54", "22.39 93.37", "25.23 97.24"),
        *("22.00 96.05", "20.47 97.02", "17.20 96.29", "16.30 97.38", "14.05 98.12"),
        *("16.53 97.38", "21.52 95.59", "19.41 97.13", "20.09 94.55"),
    )
    text = "NAME:burma14\nTYPE:CVRP\nDIMENSION:14\nCAPACITY:20\nEDGE_WEIGHT_TYPE:GEO\n"
    text += "NODE_COORD_SECTION\n" + "".join(f"{i} {p}\n" for i, p in enumerate(places, 1))
    text += "DEMAND_SECTION\n" + "".join(f"{i} {int(i > 1)}\n" for i in range(1, 15))
    text += "DEPOT_SECTION\n1 -1\n"
    rows = read_published(written(tmp_path, "b.vrp", text), "vrplib").measures["distance"]
    tour = [1, 2, 14, 3, 4, 5, 6, 12, 7, 13, 8, 11, 9, 10, 1]
    assert sum(rows[a - 1, b - 1] for a, b in pairwise(tour)) == 3323


@pytest.mark.slow
def test_a_limit_of_length_counts_service(tmp_path: Path) -> None:
    """Both stops of a corner are 14 + 1 + 15 and twice the service; a shorter limit parts them."""
    settings = SearchSettings(rounds=1)
    for limit, vehicles in ((36, 2), (35.9, 4)):
        text = f"DISTANCE : {limit}\nSERVICE_TIME : 3\nVEHICLES : 4\n{VRP}"
        text = text.replace("TYPE : CVRP", "TYPE : DCVRP")
        instance = read_published(written(tmp_path, "d.vrp", text), "vrplib")
        with ThreadPoolExecutor(1) as executor:
            plan = search_matrix_instance(instance, settings, executor, 1)
        assert (plan.unserved, plan.faults) == ((), ())
        assert sum(1 for stops in plan.routes.values() if stops) == vehicles
    windows = "TIME_WINDOW_SECTION\n" + "".join(f"{i} 0 99\n" for i in range(1, 6))
    path = written(tmp_path, "d.vrp", "DISTANCE : 9\n" + VRP.replace("EOF", windows))
    with pytest.raises(InputError, match="together with time windows"):
        read_published(path, "vrplib")


ROUTES = "Route #1: 1 2\nRoute #2: 3 4\n"
EXACT = 2 * (math.sqrt(200) + 1 + math.sqrt(221))


@pytest.mark.parametrize(
    ("form", "solution", "rounding", "note"),
    [
        ("vrplib", ROUTES + "Cost 60\n", "nearest", "rounded to whole numbers"),
        ("vrplib", ROUTES + f"Cost {EXACT:.2f}\n", "none", "distances as they are"),
        ("vrplib", "\ufeff" + ROUTES.replace("\n", "\r\n") + "Cost: 59.8\r\n", "tenths", "tenths"),
        ("solomon", ROUTES + "Cost 59.8\n", "tenths", "cut to tenths"),
        ("solomon", ROUTES + f"Cost {EXACT:.2f}\n", "none", "distances as they are"),
        ("vrplib", "Cost 50\n", "nearest", "not checked"),
        ("vrplib", ROUTES + "Cost 50\n", None, "its routes cost 60 by the instance's distances"),
        ("vrplib", f"Cost {EXACT:.2f}\n", None, "more decimals than distances rounded to whole"),
        ("solomon", f"Cost {EXACT:.2f}\n", None, "more decimals than distances cut to tenths"),
    ],
)
def test_a_gap_compares_the_same_distances(
    form: Any, solution: str, rounding: str | None, note: str, tmp_path: Path
) -> None:
    """The solution's own routes tell how it counts; where they do not fit, there is no gap."""
    name, text = ("c.VRP", VRP) if form == "vrplib" else ("c.TXT", SOLOMON)
    (tmp_path / "c.sol").write_bytes(solution.encode())
    instance = read_published(written(tmp_path, name, text), form)
    best = instance.file.best_known
    assert best is not None
    assert note in best.note
    if rounding is None:
        assert instance.gap(60.0) is None
    else:
        assert instance.file.matrix.euclidean == rounding
        assert instance.gap(best.cost) == 0.0
        assert instance.gap(2 * best.cost) == 1.0
    write_matrix_instance(instance, tmp_path / "out.json")
    assert matrix_instance_from(read_data(tmp_path / "out.json"), tmp_path / "out.json") == instance


def test_qoblib_allows_no_more_vehicles_than_its_names_say(tmp_path: Path) -> None:
    """CVRPLIB's reader gives some to spare; the solution lies in a folder beside."""
    (tmp_path / "instances").mkdir()
    (tmp_path / "solutions").mkdir()
    text = re.sub(r"NAME : .*", "NAME : XSH-n4-k3-01", VRP)
    source = written(tmp_path / "instances", "XSH-n4-k3-01.vrp", text)
    written(tmp_path / "solutions", "XSH-n4-k3-01.opt.sol", "Route #1: 1\nCost 12\n")
    read = read_published(source, "qoblib")
    assert len(read.fleet.vehicles) == 3
    assert read.file.best_known is not None
    assert read.file.best_known.cost == 12
    assert len(read_published(source, "vrplib").fleet.vehicles) > 3
    unnamed = written(tmp_path, "a.vrp", re.sub(r"NAME : .*", "NAME : a", VRP))
    with pytest.raises(InputError, match="no number of vehicles"):
        read_published(unnamed, "qoblib")


def test_thousand_stops_load(tmp_path: Path) -> None:
    """As many as the largest instance of the set X, from coordinates and from a matrix."""
    size = 1001
    data = plain()
    data["fleet"]["stops"] = [{"id": f"s{i}", "node": f"{i}"} for i in range(1, size)]
    data["fleet"]["depots"] = [{"id": "yard", "node": "0"}]
    places = [{"id": f"{i}", "x_m": float(i * 7919 % 1000), "y_m": float(i)} for i in range(size)]
    data["matrix"] = {"places": places, "euclidean": "nearest"}
    made = matrix_instance_from(data, "large.json")
    explicit = made.measures["distance"].astype(int).tolist()
    data["matrix"] = {"places": places, "distances_m": explicit}
    (tmp_path / "large.json").write_text(json.dumps(data, separators=(",", ":")))
    loaded = matrix_instance_from(read_data(tmp_path / "large.json"), tmp_path / "large.json")
    assert (loaded.measures["distance"] == made.measures["distance"]).all()


@pytest.mark.nightly
@pytest.mark.process
def test_an_import_is_solved_with_the_sets_own_cost_and_the_gap(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both corners are 2 · (14 + 1 + 15) = 60, and the best known is said to be 50. With windows,
    the stop at (10, 11) comes first.
    """
    source = written(tmp_path, "corners.vrp", VRP)
    written(tmp_path, "corners.sol", "Route #1: 1 2\nCost 50\n")
    assert main(["import", "vrplib", str(source), "--out", str(tmp_path / "out")]) == 0
    instance = str(tmp_path / "out" / "corners.json")
    assert main(["check", instance]) == 0
    capsys.readouterr()
    assert main(["solve", "--instance", instance, "--deadline", "5"]) == 0
    told = capsys.readouterr().out
    assert "60 m (distance, nearest: the set's own cost), 2 vehicles, 0 unserved" in told
    assert "best known: 50 (corners.sol), 20.00 % above it" in told
    source = written(tmp_path, "windows.txt", SOLOMON)
    assert main(["import", "solomon", str(source), "--out", str(tmp_path / "out")]) == 0
    instance = str(tmp_path / "out" / "windows.json")
    assert main(["solve", "--instance", instance, "--deadline", "5", "--json"]) == 0
    found = json.loads(capsys.readouterr().out.partition("\n")[2])
    assert ["2", "1"] in found["routes"].values()
    assert found["cost"] == pytest.approx(2 * (14.1 + 1 + 14.8))


@pytest.mark.parametrize(
    ("text", "form", "named"),
    [
        (VRP.replace("4 -10 -10", "4 -10 x"), "vrplib", "line 10: 'x' is not a number"),
        (VRP.replace("5 1\nDEPOT", "DEPOT"), "vrplib", "DEMAND_SECTION: 4 rows, of 5 places"),
        (VRP.replace("TYPE : CVRP", "TYPE : HCVRP"), "vrplib", "TYPE: a problem of type HCVRP"),
        (VRP.replace("EUC_2D", "EUC_3D"), "vrplib", "EDGE_WEIGHT_TYPE: distances of type EUC_3D"),
        ("DISTANCE : far\n" + VRP, "vrplib", "DISTANCE: 'far' is not a number"),
        ("DISTANCE : 9\nDISTANCE : 8\n" + VRP, "vrplib", "line 2: DISTANCE twice"),
        ("NODE_COORD_TYPE : THREED_COORDS\n" + VRP, "vrplib", "coordinates of type THREED_COORDS"),
        ("EDGE_DATA_FORMAT : EDGE_LIST\n" + VRP, "vrplib", "EDGE_DATA_FORMAT is not supported"),
        (VRP.replace("DEPOT_SECTION\n1\n-1\n", ""), "vrplib", "DEPOT_SECTION: 0 depots"),
        (VRP.replace("DEPOT_SECTION\n1", "DEPOT_SECTION\n1\n2"), "vrplib", "2 depots"),
        (VRP.replace("\n1 0\n2 1\n", "\n1 1\n2 1\n"), "vrplib", "the depot, has a demand"),
        (VRP.encode("utf-16"), "vrplib", "faulty.vrp: not text: encoded in UTF-16"),
        (
            SOLOMON.replace("corners", "\u00e9").encode("latin-1"),
            "solomon",
            "line 1: not text: not UTF-8",
        ),
        ("BACKHAUL_SECTION\n" + VRP, "vrplib", "line 1: BACKHAUL_SECTION is not supported"),
        (VRP.replace("CAPACITY : 2", "CAPACITY : 2.5"), "vrplib", "CAPACITY: 2.5 is not a whole"),
        (SOLOMON.replace("CUSTOMER", "CLIENT"), "solomon", "not Solomon's format"),
        (SOLOMON.replace("30        40", "30"), "solomon", "line 11: 6 numbers"),
        (SOLOMON.replace("30        40", "50        40"), "solomon", "latest_s (40) must not be"),
        ("", "solomon", "not Solomon's format"),
    ],
)
def test_a_faulty_file_of_a_set_is_one_line(
    tmp_path: Path, text: str | bytes, form: Any, named: str
) -> None:
    """With the line or key, and the mend."""
    path = tmp_path / "faulty.vrp"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError) as caught:
        read_published(path, form)
    assert named in str(caught.value)


def test_a_huge_file_of_a_set_is_refused_before_it_is_read(tmp_path: Path) -> None:
    """100 MB, by its size."""
    path = tmp_path / "huge.vrp"
    with path.open("wb") as file:
        file.truncate(100_000_000)
    with pytest.raises(InputError, match="larger than 20 MB"):
        read_published(path, "vrplib")


@settings(max_examples=150, deadline=None)
@given(st.sampled_from((VRP, LIMITED, SOLOMON)), st.data())
def test_no_text_ends_in_anything_but_an_instance_or_one_line(
    text: str, data: st.DataObject
) -> None:
    """Lines dropped, doubled and with a word replaced."""
    lines = text.splitlines()
    words = st.sampled_from(("-1", "1e400", "nan", "9" * 400, "x", ":", "1 : 2", "0 0", "", "1.5"))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(lines) - 1))
        parts = lines[at].split() or [""]
        parts[data.draw(st.integers(0, len(parts) - 1))] = data.draw(words)
        changed = " ".join(parts)
        lines[at : at + 1] = data.draw(st.sampled_from(([changed], ["", changed], [lines[at]] * 2)))
    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder), "any.vrp", "\n".join(lines))
        written(Path(folder), "any.sol", data.draw(st.sampled_from((ROUTES, ""))) + "Cost 60\n")
        told = ""
        try:
            read_published(path, "solomon" if text == SOLOMON else "vrplib")
        except InputError as error:
            told = str(error)
    assert len(told.splitlines()) <= 1


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"distances_m": [[0, 1], [1, 0]]}, "has to have 3 rows of 3"),
        ({"euclidean": "none"}, "euclidean or distances_m, not both"),
        ({"minimise": "duration"}, "minimise is duration, which is not given"),
        ({"places": [{"id": "a"}, {"id": "b"}, {"id": "b"}]}, "two places with this id"),
        ({"places": [{"id": "a"}, {"id": "b"}, {"id": "x"}]}, "fleet.stops.c"),
    ],
)
def test_faulty_matrices_are_refused_by_name(change: dict[str, Any], named: str) -> None:
    """Sizes, contradictions, and names that fit nothing."""
    data = plain()
    data["matrix"] |= change
    with pytest.raises(InputError) as caught:
        matrix_instance_from(data, "two.json")
    assert named in str(caught.value)
