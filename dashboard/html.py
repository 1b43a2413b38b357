"""The page's panels as HTML, from the view model; every foreign word is escaped."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Final

from dashboard import markup, words
from dashboard.device_line import where_it_ran
from dashboard.markup import text
from dashboard.views import (
    CycleView,
    DashboardView,
    EnergyView,
    HistoryView,
    PreviewView,
    RoadView,
    RsuView,
    VehicleView,
)
from slipstream.messages import Unserved

MAX_UNSERVED: Final = 5


def about() -> str:
    """What this page is, and the key to the map; never changes."""
    keys = [
        (markup.line_svg("stable"), "Calm traffic: close-gap platoons allowed"),
        (markup.line_svg("turbulent"), "Turbulent traffic: platoons not allowed"),
        (markup.line_svg("unknown"), "Unknown (no fresh view): not allowed"),
        (
            markup.shape_svg(
                '<line x1="0" y1="6" x2="34" y2="6" stroke="#c3cad3" stroke-width="3"/>'
            ),
            "Road without a camera",
        ),
        (
            markup.shape_svg(
                '<path d="M0 6H34M14 2l5 4-5 4" fill="none" stroke="#005ab5" stroke-width="2"/>'
            ),
            "Planned route of a van (thick: in a platoon)",
        ),
        (markup.shape_svg('<path d="M17 0l6 6-6 6-6-6z" fill="#1d2733"/>'), "Roadside camera"),
        (
            markup.shape_svg('<circle cx="17" cy="6" r="5.5" fill="#005ab5"/>'),
            "Van, where it says it is, or its plan puts it",
        ),
        (
            markup.shape_svg(
                '<path d="M5 1h10v10H5z" fill="#1d2733"/><circle cx="25" cy="6" r="4.5" '
                'fill="#1d2733"/>'
            ),
            "Depot, and customers",
        ),
    ]
    items = "".join(f"<div>{svg}{label}</div>" for svg, label in keys)
    return (
        '<div class="sl"><div>Slipstream lets delivery vans save energy by driving close behind '
        "each other, but only on roads where a <b>roadside camera has just seen calm "
        f'traffic</b>.</div><div class="key">{items}</div></div>'
    )


def summary(view: DashboardView) -> str:
    """The headline, and the last cycle in three figures."""
    tiles = unserved = device = ""
    if view.device is not None:
        line, level = view.device
        device = f'<div class="m">{markup.dot(level)} {text(line, 240)}</div>'
    if view.cycle is not None:
        cycle = view.cycle
        if cycle.unserved:
            count = words.plural(len(cycle.unserved), "stop")
            unserved = f'<div class="m">{markup.dot("warn")} {count} not served</div>'
        tiles = markup.tile(
            "Last dispatch cycle",
            f"#{cycle.number}",
            f"{text(cycle.status)}, {markup.ago(cycle.age_s)}",
        )
        if cycle.energy is not None:
            energy = cycle.energy
            tiles += markup.tile(
                "Energy of the plans",
                f"{energy.cooperative_kwh:.2f} kWh",
                f"alone: {energy.baseline_kwh:.2f} kWh",
            )
            tiles += markup.tile(
                "Saved" if energy.saved_kwh >= 0 else "Extra",
                f"{abs(energy.saved_share):.1%}",
                f"{abs(energy.saved_kwh):.3f} kWh",
            )
    problems = "".join(f"<div><small>⚠ {text(line, 200)}</small></div>" for line in view.problems)
    colour = markup.css(markup.LEVEL_RGB[view.headline_level])
    dispatcher = f"{markup.dot(view.dispatcher_level)} {text(view.dispatcher, 160)}"
    return (
        f'<div class="sl"><div class="head" style="color:{colour}">{text(view.headline)}</div>'
        f'<div class="m">{dispatcher}</div>{device}{unserved}{problems}'
        f'<div class="tiles">{tiles}</div></div>'
    )


def roads(views: Sequence[RoadView]) -> str:
    """The watched roads: traffic now, and whether the last cycle allowed platoons."""
    rows = [
        [
            text(road.segment),
            markup.chip(road.traffic),
            markup.number(road.speed_kmh, ".0f"),
            markup.number(road.cv, ".2f"),
            markup.number(road.acceleration_variance, ".2f"),
            markup.age(road.age_s),
        ]
        for road in views[: markup.MAX_ROWS]
    ]
    header = [
        "Watched roads",
        "Traffic now",
        "Speed<br>km/h",
        "Speed<br>spread (CV)",
        "Accel. var.<br>m²/s⁴",
        "Age",
    ]
    notes = [_note(road) for road in views[: markup.MAX_ROWS]]
    return markup.table(header, rows, len(views), "No camera has reported yet.", "l", notes=notes)


def vehicles(views: Sequence[VehicleView]) -> str:
    """The vans and their plans."""
    rows = [
        [
            f'<span style="color:{markup.css(van.rgb)}">⬤</span> {text(van.vehicle)}',
            text(van.activity),
            text(" → ".join(stop for stop, _ in van.stops)) or "–",
            "–" if van.idle else f"{van.distance_km:.1f}",
            f"{van.platoon_km:.1f}" if van.platoon_km else "–",
            "–" if van.idle else f"{van.energy_kwh:.2f}",
        ]
        for van in views[: markup.MAX_ROWS]
    ]
    idle = sum(van.idle for van in views)
    title = f"Vans ({len(views)}, {idle} idle)" if idle else "Vans"
    header = [title, "Now", "Stops", "km", "km in a<br>platoon", "kWh"]
    return markup.table(header, rows, len(views), "No plan has been sent yet.", "l", "l")


def cycle(view: CycleView | None) -> str:
    """The last cycle: what was decided by whom, and where the saving comes from."""
    if view is None:
        return '<div class="sl"><h3>Last dispatch cycle</h3><div class="m">None yet.</div></div>'
    cost = "–" if view.objective_kwh is None else f"{view.objective_kwh:.3f} kWh"
    feasible = {True: "feasible", False: "not feasible", None: ""}[view.feasible]
    lines = [
        f"{markup.dot(view.level)} <b>{text(view.status)}</b>"
        + (f": {text(view.reason)}" if view.reason else ""),
        f"solver <b>{text(view.solver)}</b>",
        f"cost objective <b>{cost}</b>",
        feasible,
        f"{words.plural(view.plans, 'plan')}, {words.plural(view.variables, 'variable')}",
        f"took {view.wall_s:.2f} s",
    ]
    rows = [
        [
            text(run.solver)
            + (f"<br><small>{text(words.reason(run.reason))}</small>" if run.reason else ""),
            text(run.status) + (" (repaired)" if run.repaired else ""),
            markup.number(run.objective_kwh, ".3f"),
            markup.percent(run.p_feasible_raw),
            markup.percent(run.p_feasible_repaired),
            f"{run.wall_s:.2f}",
        ]
        for run in view.solvers[: markup.MAX_ROWS]
    ]
    notes = [text(where_it_ran(run), 240) for run in view.solvers[: markup.MAX_ROWS]]
    header = [
        "Solvers",
        "Result",
        "Cost<br>kWh",
        "Valid<br>samples",
        "after<br>repair",
        "Time<br>s",
    ]
    facts = " · ".join(f'<span class="n">{line}</span>' for line in lines if line)
    return (
        f'<div class="sl"><h3>Last dispatch cycle: #{view.number}</h3><div>{facts}</div>'
        f"{_energy(view.energy)}</div>"
        + _unserved(view.unserved)
        + markup.table(
            header,
            rows,
            len(view.solvers),
            "No solver ran.",
            "l",
            notes=notes if any(notes) else (),
        )
    )


def history_title(history: HistoryView) -> str:
    """Heading of the energy chart."""
    if len(history.cycles) < 2:
        return ""
    return (
        f'<div class="sl"><h3>Energy of the last {len(history.cycles)} cycles, kWh</h3>'
        "<small>dashed: every van alone · solid: cooperative plan</small></div>"
    )


def rsus(views: Sequence[RsuView]) -> str:
    """Health of the roadside units."""
    rows = [
        [
            f"{markup.dot(unit.level)} {text(unit.rsu)}",
            text(unit.status),
            markup.number(unit.fps, ".1f"),
            " / ".join(
                markup.number(value, ".0f") for value in (unit.latency_ms_p50, unit.latency_ms_p95)
            ),
            f"{unit.frames_skipped} <small>({unit.skipped_share:.1%})</small>",
            markup.age(unit.age_s),
        ]
        for unit in views[: markup.MAX_ROWS]
    ]
    header = [
        "Roadside units",
        "Status",
        "Frames<br>per s",
        "Latency ms<br>p50 / p95",
        "Frames<br>skipped",
        "Age",
    ]
    return markup.table(header, rows, len(views), "None has reported yet.", "l")


def cameras(views: Sequence[PreviewView]) -> str:
    """The latest pictures."""
    if not views:
        return '<div class="sl m" style="padding:10px">Waiting for the first camera picture…</div>'
    pictures = []
    for view in views[:4]:
        data = base64.b64encode(view.jpeg).decode("ascii")
        faded = ";filter:grayscale(1);opacity:.45" if view.stale else ""
        age = ("old picture, " if view.stale else "") + markup.ago(view.age_s)
        label = f"{markup.dot('bad' if view.stale else view.level)} <b>{text(view.rsu)}</b>"
        pictures.append(
            f'<div class="cam"><img decoding="sync" alt="Picture of {text(view.rsu)}" '
            f'style="{faded}" src="data:image/jpeg;base64,{data}"><div>{label} '
            f"<small>{age}</small></div></div>"
        )
    more = len(views) - 4
    rest = f"<div><small>and {words.plural(more, 'camera')} more</small></div>" if more > 0 else ""
    return f'<div class="sl"><div class="cams">{"".join(pictures)}</div>{rest}</div>'


def _energy(energy: EnergyView | None) -> str:
    if energy is None:
        return '<div class="m">No energy was computed.</div>'
    parts = [
        ("distance", energy.saved_distance_kwh),
        ("drag", energy.saved_drag_kwh),
        ("acceleration", energy.saved_acceleration_kwh),
    ]
    split = " · ".join(f"{name} <b>{value:+.3f}</b>" for name, value in parts)
    verb = "saves" if energy.saved_kwh >= 0 else "costs"
    return (
        f"<div>{energy.cooperative_kwh:.3f} kWh {verb} <b>{abs(energy.saved_kwh):.3f} kWh "
        f"({abs(energy.saved_share):.1%})</b> against {energy.baseline_kwh:.3f} kWh of "
        f"<b>{text(energy.baseline)}</b></div>"
        f"<div>saved by {split} kWh · {energy.platooned_km:.1f} km in platoons</div>"
    )


def _unserved(stops: Sequence[Unserved]) -> str:
    if not stops:
        return ""
    rows = [[text(stop.stop), text(stop.reason, 160)] for stop in stops[:MAX_UNSERVED]]
    header = [f"{words.plural(len(stops), 'stop')} not served", "Why"]
    return markup.table(header, rows, len(stops), "", "l")


def _note(road: RoadView) -> str:
    now = f"now: {text(road.why)} · " if road.why else ""
    if road.gate_cycle is None:
        return f"{now}no cycle has decided on platooning here yet"
    why = f", {text(road.gate_why)}" if road.gate_why else ""
    gate = "open" if road.gate_open else "closed"
    return f"{now}platooning {gate} in cycle #{road.gate_cycle}{why}"
