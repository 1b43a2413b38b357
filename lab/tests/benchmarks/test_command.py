"""How a benchmark ends as a command."""

from __future__ import annotations

from pathlib import Path

import pytest

from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import Check, Load
from slipstream_lab.benchmarks.command import Measured, report

REACHED, MISSED = Check("a", "1", "1", True), Check("b", "1", "2", False)
UNKNOWN = Check("c", "not measured", "1", None)


@pytest.mark.parametrize(
    ("checks", "missing", "status"),
    [([REACHED, UNKNOWN], (), 0), ([REACHED, MISSED], (), 1), ([REACHED], ("a run failed",), 1)],
)
def test_aims_are_the_exit_status(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    checks: list[Check],
    missing: tuple[str, ...],
    status: int,
) -> None:
    """The report is printed whatever came out."""
    (tmp_path / "report.md").write_text("# words")
    (tmp_path / "report.json").write_text("{}")
    measured = Measured(tmp_path, checks, missing)
    assert report("bench", lambda: measured, as_json=False) == status
    assert report("bench", lambda: measured, as_json=True) == status
    assert capsys.readouterr().out == "# words{}"


@pytest.mark.parametrize(
    ("fault", "status", "told"),
    [
        (InputError("--out", "no folder", "give another"), 2, "bench: --out: no folder"),
        (RuntimeError("it died"), 1, "bench: it died"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_faults_are_told_from_misses(
    capsys: pytest.CaptureFixture[str], fault: BaseException, status: int, told: str
) -> None:
    """Bad input 2, a run that failed 1 with its trace, an interruption 130."""

    def measure() -> Measured:
        raise fault

    assert report("bench", measure, as_json=False) == status
    said = capsys.readouterr().err
    assert told in said
    assert ("Traceback" in said) == isinstance(fault, RuntimeError)


def test_load_tells_what_the_host_kept() -> None:
    """A share of all processor time since it was made."""
    told = Load(stolen_s=0.0, total_s=0.0).figures()
    share = float(told["processor time that the host kept for others"].removesuffix(" %"))
    assert 0 <= share <= 100
