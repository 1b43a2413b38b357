"""An evaluation as people read it: tables, plots, CSV and Markdown."""

from simulation.evaluation.report.ceilings import ceiling_tables
from simulation.evaluation.report.density import write_density
from simulation.evaluation.report.exogenous import exogenous_tables
from simulation.evaluation.report.files import as_json, whole_summary, write_results
from simulation.evaluation.report.formatting import Table
from simulation.evaluation.report.markdown import terminal_summary

__all__ = [
    "Table",
    "as_json",
    "ceiling_tables",
    "exogenous_tables",
    "terminal_summary",
    "whole_summary",
    "write_density",
    "write_results",
]
