"""Writes an evaluation's results into its folder."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from slipstream_lab.simulation.evaluation.arms import SHORTEST
from slipstream_lab.simulation.evaluation.measures import BIN_S, HOUR_S, Evaluation
from slipstream_lab.simulation.evaluation.report.data import arms_csv, course_csv, summary
from slipstream_lab.simulation.evaluation.report.formatting import ReportTable
from slipstream_lab.simulation.evaluation.report.markdown import report
from slipstream_lab.simulation.evaluation.report.plots import SHOWN, draw
from slipstream_lab.simulation.evaluation.runs import not_writable, write_atomically
from slipstream_lab.simulation.exogenous.recorded import Watched

_NO_PICTURES = "matplotlib is not installed, so no figure is drawn; pip install 'slipstream-lab'"


def write_results(
    folder: Path,
    evaluation: Evaluation,
    more: Sequence[ReportTable] = (),
    exogenous: Mapping[Watched, Evaluation] | None = None,
    made_up: Sequence[str] = (),
) -> str | None:
    """Write tables, figures, their data and the report; returns why there are no pictures, if so.

    The same arms give the same bytes.

    Args:
        made_up: what of the world nobody gave, in words.

    Raises:
        InputError: a file cannot be written.
    """
    names = [name for name in SHOWN if name in evaluation]
    try:
        write_atomically(folder / "arms.csv", arms_csv(evaluation))
        for watched, found in (exogenous or {}).items():
            write_atomically(folder / f"exogenous-{watched}" / "arms.csv", arms_csv(found))
        cumulative = course_csv(evaluation, [n for n in names if n != SHORTEST], BIN_S)
        write_atomically(folder / "cumulative.csv", cumulative)
        write_atomically(folder / "hourly.csv", course_csv(evaluation, names, HOUR_S))
        pictures: Sequence[str] = ()
        missing: str | None = None
        try:
            pictures = draw(evaluation, folder)
        except ModuleNotFoundError as error:
            if (error.name or "").split(".")[0] != "matplotlib":
                raise
            missing = _NO_PICTURES
        write_atomically(folder / "report.md", report(evaluation, pictures, missing, more, made_up))
        write_atomically(
            folder / "report.json", as_json(whole_summary(evaluation, more, exogenous, made_up))
        )
    except OSError as error:
        raise not_writable(Path(error.filename or folder), error) from None
    return missing


def whole_summary(
    evaluation: Evaluation,
    more: Sequence[ReportTable] = (),
    exogenous: Mapping[Watched, Evaluation] | None = None,
    made_up: Sequence[str] = (),
) -> dict[str, Any]:
    """Means and spreads of all arms, and further tables as the report has them."""
    return {
        **summary(evaluation),
        "made_up": list(made_up),
        "exogenous": {name: summary(found) for name, found in (exogenous or {}).items()},
        "tables": [asdict(table) for table in more],
    }


def as_json(document: Any) -> str:
    """One line a value, for people and for comparing."""
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
