/** A table that draws only the rows in view, so that ten thousand scroll smoothly. */

import { h, setText } from "./dom.js";
import { RowOrder } from "./rows.js";

export const ROW_PX = 28;
const SPARE_ROWS = 6;

/** One table with sorting, filtering and a selection. */
export class DataTable {
  /**
   * @param {HTMLElement} host
   * @param {{label: string, columns: any[], trouble: (row: any) => number, empty: string,
   *   onSelect: (id: string) => void, onCount: (shown: number, all: number) => void}} options
   */
  constructor(host, options) {
    this.options = options;
    this.order = new RowOrder(options.columns, options.trouble);
    this.rows = new Map();
    /** @type {string|null} */
    this.selected = null;
    this.active = 0;
    this.columns = [];
    this.head = h("tr", { role: "row" });
    this.body = h("tbody", { role: "rowgroup" });
    this.above = h("tr", { "aria-hidden": "true" }, h("td"));
    this.below = h("tr", { "aria-hidden": "true" }, h("td"));
    this.widths = h("colgroup");
    this.table = h("table.rows", { role: "grid", tabindex: "0", "aria-label": options.label },
      this.widths, h("thead", { role: "rowgroup" }, this.head), h("tbody", { role: "presentation" }, this.above), this.body,
      h("tbody", { role: "presentation" }, this.below));
    this.none = h("p.empty", {}, options.empty);
    this.scroller = h("div.scroller", {}, this.table, this.none);
    host.replaceChildren(this.scroller);
    this._listen();
  }

  _listen() {
    this.scroller.addEventListener("scroll", () => this._draw(), { passive: true });
    new ResizeObserver(() => this._fit()).observe(this.scroller);
    this.table.addEventListener("click", (event) => {
      const target = /** @type {Element} */ (event.target);
      const key = target.closest("button[data-sort]")?.getAttribute("data-sort");
      if (key) this._sortBy(key);
      const id = target.closest("tr[data-id]")?.getAttribute("data-id");
      if (id) this._choose(id);
    });
    this.table.addEventListener("keydown", (event) => this._key(event));
    this.body.addEventListener("pointerenter", () => { this.pointed = true; });
    this.body.addEventListener("pointerleave", () => { this.pointed = false; });
  }

  /** @param {Map<string, any>} rows @param {Set<string>|null} changed */
  update(rows, changed) {
    const known = this.rows === rows;
    this.rows = rows;
    // A row does not slip away from under a pointer that is about to press it.
    this.order.update(rows, known ? changed : null, Boolean(this.pointed) && known);
    this._draw();
  }

  /** @param {string} text @param {string} level "", "trouble" or a level */
  filter(text, level = "") {
    this.order.filter = text;
    this.order.level = level;
    this.order.update(this.rows, new Set());
    this.scroller.scrollTop = 0;
    this._draw();
  }

  /** Marks a row and brings it into view. @param {string|null} id */
  select(id) {
    this.selected = id;
    const place = id === null ? -1 : this.order.ids.indexOf(id);
    if (place >= 0) this._reveal(place);
    this._draw();
  }

  _choose(id) {
    this.active = this.order.ids.indexOf(id);
    this.options.onSelect(id);
  }

  _sortBy(key) {
    const { sort } = this.order;
    const figure = this.options.columns.find((column) => column.key === key)?.figure;
    const first = Boolean(figure);
    if (sort?.key !== key) this.order.sort = { key, down: first };
    else this.order.sort = sort.down === first ? { key, down: !first } : null;
    this.order.update(this.rows, new Set());
    this._drawHead();
    this._draw();
  }

  _key(event) {
    if (event.target !== this.table) return;
    const page = Math.max(1, Math.floor(this.scroller.clientHeight / ROW_PX) - 2);
    const steps = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -Infinity, End: Infinity };
    if (event.key in steps) {
      this.active = clamp(this.active + steps[event.key], 0, this.order.ids.length - 1);
      this._reveal(this.active);
      this._draw();
    } else if (event.key === "Enter" || event.key === " ") {
      const id = this.order.ids[this.active];
      if (id !== undefined) this._choose(id);
    } else return;
    event.preventDefault();
  }

  _reveal(place) {
    this.active = place;
    const top = place * ROW_PX;
    const room = this.scroller.clientHeight - ROW_PX;
    if (top < this.scroller.scrollTop) this.scroller.scrollTop = top;
    else if (top + ROW_PX > this.scroller.scrollTop + room) this.scroller.scrollTop = top + ROW_PX - room;
  }

  /** Leaves to the card what there is no room for. */
  _fit() {
    const room = this.scroller.clientWidth;
    if (!room || room === this.room) return this._draw();
    this.room = room;
    let used = 0;
    const kept = new Set();
    for (const column of [...this.options.columns].sort((a, b) => a.rank - b.rank)) {
      if (used + column.width > room && column.rank > 0) break;
      used += column.width;
      kept.add(column);
    }
    this.columns = this.options.columns.filter((column) => kept.has(column));
    const grows = this.columns.some((column) => column.grow);
    this.widths.replaceChildren(...this.columns.map((column, i) => h("col", {
      width: column.grow || (!grows && i === this.columns.length - 1) ? null : column.width,
    })));
    for (const cell of [this.above.firstElementChild, this.below.firstElementChild]) cell?.setAttribute("colspan", String(this.columns.length));
    this.body.replaceChildren();
    this._drawHead();
    this._draw();
  }

  _drawHead() {
    const { sort } = this.order;
    const focused = document.activeElement?.getAttribute("data-sort");
    this.head.replaceChildren(...this.columns.map((column) => {
      const sorted = sort?.key === column.key ? (sort.down ? "descending" : "ascending") : null;
      const arrow = sorted ? (sort?.down ? " ↓" : " ↑") : "";
      const label = column.short === undefined ? column.label : column.short;
      return h(column.figure ? "th.num" : "th", { role: "columnheader", scope: "col", "aria-sort": sorted },
        h("button", { type: "button", "data-sort": column.key, title: `Sort by ${column.label.toLowerCase()}`, "aria-label": column.label }, label + arrow || "⇅"));
    }));
    if (focused) /** @type {HTMLElement|null} */ (this.head.querySelector(`[data-sort="${focused}"]`))?.focus();
  }

  _draw() {
    const { ids } = this.order;
    this.options.onCount(ids.length, this.rows.size);
    this.none.hidden = ids.length > 0;
    setText(this.none, this.rows.size ? "Nothing matches the filter." : this.options.empty);
    this.table.setAttribute("aria-rowcount", String(ids.length + 1));
    const height = this.scroller.clientHeight;
    if (!height || !this.columns.length) return;
    const first = clamp(Math.floor(this.scroller.scrollTop / ROW_PX) - SPARE_ROWS, 0, Math.max(0, ids.length - 1));
    const last = Math.min(ids.length, first + Math.ceil(height / ROW_PX) + 2 * SPARE_ROWS);
    space(this.above, first);
    space(this.below, ids.length - last);
    while (this.body.childElementCount > last - first) this.body.lastElementChild?.remove();
    for (let i = first; i < last; i += 1) this._drawRow(this._row(i - first), ids[i], i);
    const active = ids[this.active];
    if (active !== undefined && this.active >= first && this.active < last) this.table.setAttribute("aria-activedescendant", rowId(this.options.label, this.active));
    else this.table.removeAttribute("aria-activedescendant");
  }

  _row(place) {
    const old = this.body.children[place];
    if (old) return old;
    const row = h("tr", { role: "row" }, this.columns.map((column) => h(column.figure ? "td.num" : "td", { role: "gridcell", "data-column": column.key }, h("span"))));
    this.body.append(row);
    return row;
  }

  _drawRow(row, id, place) {
    const values = this.rows.get(id);
    if (!values) return;
    set(row, "data-id", id);
    set(row, "id", rowId(this.options.label, place));
    set(row, "aria-rowindex", String(place + 2));
    set(row, "aria-selected", String(id === this.selected));
    row.classList.toggle("active", place === this.active);
    this.columns.forEach((column, i) => {
      const cell = /** @type {HTMLElement} */ (row.children[i]);
      const text = column.text(values, id);
      const label = /** @type {Element} */ (cell.lastElementChild);
      if (label.textContent !== text) {
        label.textContent = text;
        if (column.whole) cell.title = column.whole(values);
        else if (!column.figure && text.length > 8) cell.title = text;
        else cell.removeAttribute("title");
      }
      column.paint?.(cell, values, id);
    });
  }
}

function rowId(label, place) { return `row-${label.toLowerCase()}-${place}`; }

function space(row, count) {
  row.hidden = count === 0;
  /** @type {HTMLElement} */ (row.firstElementChild).style.height = `${count * ROW_PX}px`;
}

function set(node, name, value) { if (node.getAttribute(name) !== value) node.setAttribute(name, value); }

function clamp(value, low, high) { return Math.max(low, Math.min(high, value)); }
