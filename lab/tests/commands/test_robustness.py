"""`slipstream robustness` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slipstream.messages import Estimate, KinematicFeatures, SegmentState
from slipstream_cli.main import main


def write_states(path: Path, variances: list[float]) -> Path:
    """One state for each acceleration variance, all with CV 0.05."""
    lines = []
    for number, variance in enumerate(variances):
        zero = Estimate(value=0.0)
        features = KinematicFeatures(
            mean_speed_mps=Estimate(value=20.0),
            mean_acceleration_mps2=zero,
            density_veh_per_m=zero,
            speed_std_mps=Estimate(value=1.0),
            acceleration_variance_m2ps4=Estimate(value=variance, standard_error=0.05),
        )
        state = SegmentState(
            rsu="r",
            segment=f"s{number}",
            sequence=number,
            time_ns=number,
            window_s=10.0,
            features=features,
            y_e=1,
            reason=None,
            vehicles=5,
            frames=100,
            coverage=1.0,
        )
        lines.append(state.to_bytes().decode())
    path.write_text("\n".join(lines) + "\n\n")
    return path


def test_the_table_stands_beside_the_papers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Levels, shares with their errors, the paper's figures; the seed fixes it."""
    states = write_states(tmp_path / "states.jsonl", [0.1, 0.3, 0.4, 0.45, 0.9])
    assert main(["robustness", str(states), "--seed", "4"]) == 0
    first = capsys.readouterr().out
    assert "4 stable states of 4 segments, 1 turbulent, 0 unknown" in first
    for level, paper in (("10%", "94.2%"), ("20%", "88.5%"), ("30%", "82.1%")):
        (line,) = [li for li in first.splitlines() if li.strip().startswith(level)]
        assert "±" in line
        assert paper in line
    assert main(["robustness", str(states), "--seed", "4"]) == 0
    assert capsys.readouterr().out == first


def test_the_table_is_json_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """More noise, fewer stable; several files are one set."""
    files = [str(write_states(tmp_path / f"{n}.jsonl", [0.3, 0.45])) for n in (1, 2)]
    assert main(["robustness", *files, "--noise", "0", "10", "35", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    shares = [row["stable_share"] for row in result["rows"]]
    assert shares[0] == 1.0
    assert shares[0] > shares[1] > shares[2]
    assert [row["paper_stable_share"] for row in result["rows"]] == [1.0, 0.942, None]
    assert result["stable"] == 4


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ([], "slipstream track VIDEO"),
        (["none.jsonl"], "slipstream track VIDEO"),
        (["bad.jsonl"], "line 2"),
        (["turbulent.jsonl"], "no state is stable"),
        (["good.jsonl", "--noise", "-1"], "--noise"),
        (["good.jsonl", "--noise", "nan"], "--noise"),
        (["good.jsonl", "--draws", "0"], "--draws"),
        (["good.jsonl", "--seed", "-1"], "--seed"),
        (["."], "directory"),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    problem: str,
) -> None:
    """It says what is wrong, and what to run where there are no states."""
    monkeypatch.chdir(tmp_path)
    good = write_states(tmp_path / "good.jsonl", [0.1])
    write_states(tmp_path / "turbulent.jsonl", [3.0])
    (tmp_path / "bad.jsonl").write_text(good.read_text().splitlines()[0] + "\n{}\n")
    assert main(["robustness", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert problem.lower() in line.lower()
