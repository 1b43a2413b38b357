"""The page's style, and the small pieces that its blocks are made of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from itertools import zip_longest

from dashboard import words
from dashboard.words import Level, Rgb, Traffic

MAX_ROWS = 20
LEVEL_RGB: dict[Level, Rgb] = {"ok": (0, 128, 94), "warn": (176, 104, 0), "bad": (190, 50, 20)}

STYLE = """<style>
.sl{font-size:13px;line-height:1.4;color:#1d2733;padding:2px 12px}
.sl h3{font-size:13px;margin:11px 0 2px;font-weight:650}
.sl table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
.sl th{font-weight:500;color:#5b6776;font-size:11.5px;text-align:right;padding:2px 0 3px 8px;
  border-bottom:1px solid #d9dee5;vertical-align:bottom;line-height:1.2}
.sl td{padding:3px 0 3px 8px;text-align:right;border-bottom:1px solid #eef1f4;
  vertical-align:top;overflow-wrap:anywhere}
.sl th:first-child,.sl td:first-child,.sl .l{text-align:left}
.sl th:first-child,.sl td:first-child{padding-left:0}
.sl th:first-child{font-weight:650;color:#1d2733;font-size:13px}.sl table{margin-top:9px}
.sl tr.noted td{border:0;padding-bottom:0}.sl tr.note td{padding-top:0}
.sl .m{color:#5b6776}.sl small{font-size:11.5px;color:#5b6776}.sl .n{white-space:nowrap}
.sl .chip{display:inline-block;border-radius:9px;padding:0 8px;color:#fff;font-weight:600;
  white-space:nowrap}
.sl .tiles{display:flex;gap:8px;margin:6px 0 2px}
.sl .tile{flex:1;background:#f4f6f8;border-radius:6px;padding:6px 10px;min-width:0}
.sl .tile b{display:block;font-size:19px;line-height:1.25;font-weight:650}
.sl .head{font-size:17px;font-weight:650;margin:4px 0 0}
.sl .key{display:grid;grid-template-columns:auto auto;gap:1px 18px;justify-content:start;
  margin:6px 0 4px;align-items:center}
.sl .key svg{vertical-align:-2px;margin-right:8px}
.sl .cams{display:flex;gap:10px;flex-wrap:wrap;padding:2px 0 4px}
.sl .cam{width:300px}
.sl .cam img{display:block;width:300px;aspect-ratio:16/9;object-fit:cover;background:#e6eaee;
  border-radius:4px}
</style>"""


def text(value: str, limit: int = 80) -> str:
    """Foreign text made safe to show: cut to a sane length, escaped."""
    return escape(value if len(value) <= limit else value[: limit - 1] + "…")


def table(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    total: int,
    empty: str,
    *left: str,
    notes: Sequence[str] = (),
) -> str:
    """A table in the page's style; one line in its place where there are no rows.

    Args:
        header: HTML of the column heads; the first one also heads the table.
        rows: HTML of the cells.
        total: how many rows there would be, had they not been cut.
        empty: what to say where there are none.
        left: "l" for each column after the first that is flush left.
        notes: HTML of a line under each row, as wide as the table.
    """
    if not rows:
        return f'<div class="sl"><h3>{header[0]}</h3><div class="m">{empty}</div></div>'
    # The first column is always flush left; `left` flags the ones after it.
    classes = ["", *left] + [""] * (len(header) - 1 - len(left))
    row_start = '<tr class="noted">' if notes else "<tr>"
    note_start = f'<tr class="note"><td colspan="{len(header)}"><small>'
    body = "".join(
        f"{row_start}{_cells('td', row, classes)}</tr>"
        + (f"{note_start}{note}</small></td></tr>" if note else "")
        for row, note in zip_longest(rows, notes, fillvalue="")
    )
    more = total - len(rows)
    rest = f"<small>and {more} more</small>" if more else ""
    return (
        f'<div class="sl"><table><thead><tr>{_cells("th", header, classes)}</tr></thead>'
        f"<tbody>{body}</tbody></table>{rest}</div>"
    )


def _cells(tag: str, cells: Iterable[str], classes: Sequence[str]) -> str:
    return "".join(
        f'<{tag} class="{name}">{cell}</{tag}>' if name else f"<{tag}>{cell}</{tag}>"
        for cell, name in zip(cells, classes, strict=True)
    )


def tile(label: str, figure: str, note: str) -> str:
    """A figure with its label above and a note below."""
    return f'<div class="tile"><small>{label}</small><b>{figure}</b><small>{note}</small></div>'


def chip(traffic: Traffic) -> str:
    """The word for traffic on its colour, with its sign."""
    colour = css(words.TRAFFIC_RGB[traffic])
    return (
        f'<span class="chip" style="background:{colour}">{words.TRAFFIC_SIGN[traffic]} '
        f"{traffic}</span>"
    )


def dot(level: Level) -> str:
    """A mark for a level, told by shape as well as by colour."""
    sign = {"ok": "●", "warn": "▲", "bad": "■"}[level]
    return f'<span style="color:{css(LEVEL_RGB[level])}">{sign}</span>'


def number(value: float | None, form: str) -> str:
    """A number, or a dash for None."""
    return "–" if value is None else format(value, form)


def percent(share: float | None) -> str:
    """A share in per cent, small ones with two digits."""
    if share is None:
        return "–"
    return f"{share:.0%}" if share in (0.0, 1.0) or share >= 0.1 else f"{share * 100:.2g}%"


def age(age_s: float | None) -> str:
    """An age, kept on one line."""
    return "–" if age_s is None else f'<span class="n">{words.duration(age_s)}</span>'


def ago(age_s: float) -> str:
    """An age in a sentence."""
    return f"{words.duration(age_s)} ago"


def css(rgb: Rgb) -> str:
    """A colour as CSS writes it."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)


def line_svg(traffic: Traffic) -> str:
    """A piece of road as the map draws it."""
    pattern = {"stable": "", "turbulent": "10 5", "unknown": "5 5"}[traffic]
    return shape_svg(
        f'<line x1="0" y1="6" x2="34" y2="6" stroke="{css(words.TRAFFIC_RGB[traffic])}" '
        f'stroke-width="7" stroke-dasharray="{pattern}"/>'
    )


def shape_svg(shape: str) -> str:
    """A sample of something on the map, for its key."""
    return f'<svg width="34" height="12" aria-hidden="true">{shape}</svg>'
