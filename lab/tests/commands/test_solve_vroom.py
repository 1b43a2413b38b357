from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from slipstream_cli.main import main

REQUEST = {
    "vehicles": [{"id": 1, "start_index": 0, "end_index": 0}],
    "jobs": [{"id": 4, "location_index": 1}],
    "matrices": {"car": {"durations": [[0, 60], [90, 0]]}},
}


def written(folder: Path, request: Any) -> str:
    """A request's file."""
    path = folder / "request.json"
    path.write_text(json.dumps(request))
    return str(path)


def test_a_request_is_answered_on_the_output_or_in_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same answer in both."""
    path = written(tmp_path, REQUEST)
    assert main(["solve", "--vroom", path, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["code"], answer["summary"]["cost"]) == (0, 150)
    out = tmp_path / "answer.json"
    assert main(["solve", "--vroom", path, "--out", str(out)]) == 0
    assert json.loads(out.read_text()) == answer
    assert capsys.readouterr().out == ""


def test_what_is_not_read_is_said_on_standard_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The request is answered all the same."""
    assert main(["solve", "--vroom", written(tmp_path, REQUEST | {"depots": []}), "--json"]) == 0
    told = capsys.readouterr()
    (line,) = json.loads(told.out)["warnings"]
    assert "depots: unknown key, not read" in line
    assert told.err == f"slipstream: {line}\n"


def test_a_faulty_request_is_one_line_and_an_answer_with_its_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit status 2, for input and for places off the roads."""
    places = {
        "vehicles": [{"id": 1, "start": [2.35, 48.7]}],
        "jobs": [{"id": 1, "location": [2, 48]}],
    }
    for request, options, code, named in (
        (REQUEST | {"vehicles": []}, [], 2, "vehicles: it is empty; give an entry"),
        (places, [], 2, "give a road network"),
        (places, ["--network", "demo"], 3, "location"),
    ):
        assert main(["solve", "--vroom", written(tmp_path, request), *options]) == 2
        told = capsys.readouterr()
        answer = json.loads(told.out)
        assert answer["code"] == code
        assert named in answer["error"]
        assert told.err == f"slipstream: {answer['error']}\n"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--vroom", "{path}", "--solver", "exact"], "--solver: not for --vroom"),
        (["--vroom", "{path}", "--objective", "energy"], "needs roads"),
        (["--vroom", "{path}", "--geometry"], "geometry: needs roads"),
        (["--vroom", "{folder}/none.json"], "no such file"),
        (["--vroom", "{folder}/huge.json"], "larger than 8 MB"),
        (["--instance", "arc06-valley", "--network", "demo"], "--network: only for --vroom"),
    ],
)
def test_what_does_not_fit_together_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], named: str
) -> None:
    """One line, exit status 2; 100 MB are not read."""
    with (tmp_path / "huge.json").open("wb") as file:
        file.truncate(100_000_000)
    path = written(tmp_path, REQUEST)
    assert main(["solve", *(a.format(path=path, folder=tmp_path) for a in arguments)]) == 2
    told = capsys.readouterr().err
    assert named in told
    assert len(told.splitlines()) == 1
