"""An evaluation as people read it: tables, plots, CSV and Markdown."""

from slipstream_lab.simulation.evaluation.report.ceilings import ceiling_tables
from slipstream_lab.simulation.evaluation.report.density import density_shares, density_tables
from slipstream_lab.simulation.evaluation.report.exogenous import exogenous_tables
from slipstream_lab.simulation.evaluation.report.files import as_json, whole_summary, write_results
from slipstream_lab.simulation.evaluation.report.formatting import (
    ReportTable,
    as_markdown,
    number,
    percent,
)
from slipstream_lab.simulation.evaluation.report.markdown import terminal_summary
from slipstream_lab.simulation.evaluation.report.plots import pyplot, tidy

__all__ = [
    "ReportTable",
    "as_json",
    "as_markdown",
    "ceiling_tables",
    "density_shares",
    "density_tables",
    "exogenous_tables",
    "number",
    "percent",
    "pyplot",
    "terminal_summary",
    "tidy",
    "whole_summary",
    "write_results",
]
