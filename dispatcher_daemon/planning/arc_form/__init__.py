"""The paper's arc form of a cycle: candidate arcs with rewards, solved as one problem."""

from __future__ import annotations

from dispatcher_daemon.planning.arc_form.arcs import arc_problem_of
from dispatcher_daemon.planning.arc_form.cycle import arc_cycle
from dispatcher_daemon.planning.arc_form.form import ArcForm, arc_form, arc_form_obstacle

__all__ = ["ArcForm", "arc_cycle", "arc_form", "arc_form_obstacle", "arc_problem_of"]
