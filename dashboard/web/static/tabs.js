/** The tabs on the left: tables, cameras, energy. */

import { byId, h, setText } from "./dom.js";
import { TROUBLE } from "./columns.js";
import { DataTable } from "./tables.js";

export const TABS = [
  ["vehicles", "Vehicles", "No vehicle is known yet: none has a plan or has reported."],
  ["roads", "Roads", "No road is watched yet: no roadside unit has sent a state."],
  ["rsus", "RSUs", "No roadside unit has been heard yet."],
  ["orders", "Orders", "There are no orders, nor any that ended in the last 24 hours."],
  ["cycles", "Cycles", "The dispatcher has run no cycle yet."],
  ["alarms", "Alarms", "No alarm: nothing is wrong."],
  ["cameras", "Cameras", ""],
  ["energy", "Energy", ""],
];
/** How many rows the server lists at most (docs/page.md), and where the others are. */
const LISTED = {
  orders: [5000, "Of open orders and those that ended in the last 24 hours, open ones first. All: slipstream orders list"],
  cycles: [200, "Earlier ones: move the time bar, or slipstream export cycles"],
};
/** Room of the sign that there are more tabs. */
const SIGN_PX = 34;
const SINGULAR = { vehicles: "vehicle", roads: "road", rsus: "rsu", orders: "order", cycles: "cycle", alarms: "alarm" };

/** Shows one tab at a time, and keeps each table's filter. */
export class Tabs {
  /**
   * @param {Object<string, any[]>} columns
   * @param {{onTab: (name: string) => void, onSelect: (kind: string, id: string) => void}} handlers
   */
  constructor(columns, handlers) {
    this.handlers = handlers;
    this.name = "vehicles";
    this.list = byId("tabs");
    /** @type {Map<string, DataTable>} */
    this.tables = new Map();
    this.filters = new Map();
    /** Tables out of sight that catch up when they are opened. */
    this.stale = new Set();
    this.list.replaceChildren(...TABS.map(([name, label]) => h("button", {
      type: "button", role: "tab", id: `tab-${name}`, "aria-controls": `pane-${name}`, "data-tab": name,
    }, label, h("span.count.num", { "data-count": name }))));
    for (const [name, label, empty] of TABS) {
      const pane = byId(`pane-${name}`);
      if (!(name in TROUBLE)) continue;
      this.tables.set(name, new DataTable(pane, {
        label, columns: columns[name], trouble: TROUBLE[name], empty,
        onSelect: (id) => handlers.onSelect(SINGULAR[name], id),
        onCount: (shown, all) => { if (name === this.name) this._count(shown, all); },
      }));
    }
    this.field = byId("filter");
    this.field.addEventListener("input", () => this._filter(this.field.value, ""));
    this.field.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      this.field.value = "";
      this._filter("", "");
    });
    this.list.addEventListener("keydown", (event) => this._key(event));
    this.list.addEventListener("scroll", () => this._more(), { passive: true });
    new ResizeObserver(() => this._more()).observe(this.list);
  }

  /** Scrolls to the open tab, clear of the signs at both ends. */
  _reveal() {
    const { list } = this;
    const button = byId(`tab-${this.name}`);
    this.width = list.scrollWidth;
    if (button.offsetLeft - SIGN_PX < list.scrollLeft || button.offsetLeft + button.offsetWidth + SIGN_PX > list.scrollLeft + list.clientWidth) list.scrollLeft = button.offsetLeft - SIGN_PX;
    this._more();
  }

  /** Says on which sides tabs are out of sight. */
  _more() {
    const { list } = this;
    const hidden = list.scrollWidth - list.clientWidth;
    list.dataset.more = [list.scrollLeft > 1 && "left", list.scrollLeft < hidden - 1 && "right"].filter(Boolean).join(" ");
  }

  /** Ids of the rows that the open table shows, in their order; null: no table is open. @returns {string[]|null} */
  get ids() { return this.tables.get(this.name)?.order.ids ?? null; }

  /** @param {string} name */
  open(name) {
    this.name = TABS.some(([tab]) => tab === name) ? name : "vehicles";
    for (const [tab] of TABS) {
      const chosen = tab === this.name;
      const button = byId(`tab-${tab}`);
      button.setAttribute("aria-selected", String(chosen));
      button.tabIndex = chosen ? 0 : -1;
      byId(`pane-${tab}`).hidden = !chosen;
    }
    this._reveal();
    const table = this.tables.get(this.name);
    byId("tools").hidden = !table;
    const filter = this.filters.get(this.name) ?? { text: "", level: "" };
    this.field.value = filter.level || filter.text;
    if (table) this._count(table.order.ids.length, table.rows.size);
  }

  /** Opens a tab with a filter: "" for none, "trouble" for what is not well. */
  openFiltered(name, filter) {
    this.handlers.onTab(name);
    if (!this.tables.has(name)) return;
    this.field.value = filter;
    this._filter(filter, filter === "trouble" ? "trouble" : "");
  }

  _filter(text, level) {
    // The word itself, typed, means the same.
    const trouble = level || (text.trim().toLowerCase() === "trouble" ? "trouble" : "");
    this.filters.set(this.name, { text, level: trouble });
    this.tables.get(this.name)?.filter(trouble ? "" : text, trouble);
  }

  _count(shown, all) {
    const rows = `${all.toLocaleString("en-GB")} ${all === 1 ? "row" : "rows"}`;
    setText(byId("shown"), shown === all ? rows : `${shown.toLocaleString("en-GB")} of ${rows}`);
    const [most, where] = LISTED[this.name] ?? [Infinity, ""];
    byId("shown-more").hidden = all < most;
    if (all >= most) setText(byId("shown-more"), `${most.toLocaleString("en-GB")} are listed. ${where}.`);
  }

  /** @param {import("./store.js").Tables} tables @param {import("./store.js").Changed} changed */
  update(tables, changed) {
    for (const [name, table] of this.tables) {
      const rows = tables[name];
      const badge = /** @type {Element} */ (this.list.querySelector(`[data-count="${name}"]`));
      setText(badge, name === "alarms" ? String([...rows.values()].filter((row) => !row.ended).length) : rows.size.toLocaleString("en-GB"));
      if (name === this.name) table.update(rows, this.stale.has(name) ? null : changed?.[name] ?? null);
      else this.stale.add(name);
    }
    this.stale.delete(this.name);
    // Their counts make them wider.
    if (this.width !== this.list.scrollWidth) this._reveal();
  }

  /** @param {{kind: string, id: string}|null} selection */
  select(selection) {
    for (const [name, table] of this.tables) table.select(selection && SINGULAR[name] === selection.kind ? selection.id : null);
  }

  _key(event) {
    const names = TABS.map(([name]) => name);
    const place = names.indexOf(this.name);
    const next = { ArrowRight: place + 1, ArrowLeft: place - 1, Home: 0, End: names.length - 1 }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    const name = names[(next + names.length) % names.length];
    this.handlers.onTab(name);
    byId(`tab-${name}`).focus();
  }
}
