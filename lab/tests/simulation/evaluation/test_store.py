"""Finished arms in a folder."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from lab.tests.simulation.evaluation.fakes import GROUND, make_arm
from slipstream.errors import InputError
from slipstream_lab.simulation.evaluation.arms import POLICIES
from slipstream_lab.simulation.evaluation.runs.provenance import code_stamp
from slipstream_lab.simulation.evaluation.runs.store import ArmStore

C = POLICIES["C"]


def test_an_arm_comes_back_as_it_was(tmp_path: Path) -> None:
    """Every float to its last bit; the same arm is the same file."""
    arm = make_arm(C, 3)
    with ArmStore(tmp_path / "deep" / "out", GROUND, "code") as store:
        assert store.get(C, 3) is None
        store.put(C, 3, arm)
        first = store.get(C, 3)
        store.put(C, 3, arm)
        assert first == store.get(C, 3)
        assert store.get(C, 4) is None
    assert first is not None
    assert first.result == arm
    assert (first.file, first.code) == ("arms/C-3.json", "code")
    assert not [path for path in (store.folder / "arms").iterdir() if path.suffix == ".part"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"signals": "fixed"}, "signals was actuated, is fixed"),
        ({"net": "x" * 64}, "net was nnnnnnnn, is xxxxxxxx"),
        ({"end_s": 86400.0}, "end_s was 32400.0, is 86400.0"),
        ({"format": 99}, "is 99"),
        ({"waiting_kw": 0.0}, "waiting_kw was None, is 0.0"),
        ({"standing_kw": 2.0}, "standing_kw was None, is 2.0"),
    ],
)
def test_arms_of_another_evaluation_are_not_taken_for_these(
    tmp_path: Path, change: dict[str, object], said: str
) -> None:
    """One line names the folder, what differs, and the mend."""
    with ArmStore(tmp_path, GROUND, "code") as store:
        store.put(C, 1, make_arm(C, 1))
    with (
        ArmStore(tmp_path, replace(GROUND, **change), "code") as other,  # type: ignore[arg-type]
        pytest.raises(InputError) as caught,
    ):
        other.get(C, 1)
    line = str(caught.value)
    assert str(tmp_path) in line
    assert said in line
    assert "another folder" in line


def test_arms_of_before_there_were_prices_of_waiting_are_read(tmp_path: Path) -> None:
    """They waited at the value of driving time, which is what no price means."""
    with ArmStore(tmp_path, GROUND, "code") as store:
        store.put(C, 1, make_arm(C, 1))
        path = tmp_path / "arms" / "C-1.json"
        document = json.loads(path.read_text())
        del document["ground"]["waiting_kw"], document["ground"]["standing_kw"]
        path.write_text(json.dumps(document))
        assert store.get(C, 1) is not None


def test_an_arm_whose_policy_has_changed_since_is_not_taken(tmp_path: Path) -> None:
    """A name alone does not make an arm."""
    with ArmStore(tmp_path, GROUND, "code") as store:
        store.put(C, 1, make_arm(C, 1))
        with pytest.raises(InputError, match="another policy"):
            store.get(replace(C, coasting_budget=0.2), 1)


@pytest.mark.parametrize("damage", ["", "{}", "[1]", '{"ground": 7}', "cut"])
def test_a_damaged_file_is_named(tmp_path: Path, damage: str) -> None:
    """The line says that deleting it is enough."""
    with ArmStore(tmp_path, GROUND, "code") as store:
        store.put(C, 1, make_arm(C, 1))
        path = tmp_path / "arms" / "C-1.json"
        path.write_text(path.read_text()[:-200] if damage == "cut" else damage)
        with pytest.raises(InputError, match="delete the file") as caught:
            store.get(C, 1)
        assert str(path) in str(caught.value)


def test_a_result_without_one_of_its_parts_is_damaged(tmp_path: Path) -> None:
    """What an older version has stored is not read as if it were whole."""
    with ArmStore(tmp_path, GROUND, "code") as store:
        store.put(C, 1, make_arm(C, 1))
        path = tmp_path / "arms" / "C-1.json"
        document = json.loads(path.read_text())
        del document["result"]["collisions"]
        path.write_text(json.dumps(document))
        with pytest.raises(InputError, match="no arm's result"):
            store.get(C, 1)


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    """The second one is told so; once the first has ended, it may."""
    with ArmStore(tmp_path, GROUND, "code"), pytest.raises(InputError, match="another run"):
        ArmStore(tmp_path, GROUND, "code")
    with ArmStore(tmp_path, GROUND, "code"):
        pass


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    """A file where the folder should be."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--out"):
        ArmStore(tmp_path / "file", GROUND, "code")


def test_the_codes_stamp_is_the_same_every_time() -> None:
    """Of the same sources, with the versions that people know them by."""
    assert code_stamp() == code_stamp()
    assert "libsumo" in code_stamp()
