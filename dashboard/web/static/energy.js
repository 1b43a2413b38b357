/** The energy tab: saved today, this week, since the start; by hour, by day, and summed up. */

import { getJson } from "./api.js";
import { barChart, lineChart } from "./chart.js";
import { h, morph } from "./dom.js";
import { energyParts, partsOf } from "./energy_parts.js";

const HOUR = 3_600_000;
const DAY = 24 * HOUR;
const REFRESH_MS = 60_000;

/** Shows sums at each change, and charts of stored hours and days at each minute. */
export class EnergyPanel {
  /** @param {HTMLElement} root @param {import("./format.js").Format} format @param {boolean} history */
  constructor(root, format, history) {
    this.root = root;
    this.format = format;
    this.history = history;
    /** @type {any} */
    this.energy = null;
    this.now = 0;
    /** @type {{hour: any[], day: any[]}|null} */
    this.rows = null;
    this.asked = { at: 0, t: /** @type {number|null} */ (null) };
    new ResizeObserver(() => this._draw()).observe(root);
  }

  /** @param {any} energy the moment's Energy @param {number} now ms @param {number|null} t a past moment */
  show(energy, now, t) {
    this.energy = energy;
    this.now = now;
    if (this.history && (Date.now() - this.asked.at > REFRESH_MS || this.asked.t !== t)) this._ask(now, t);
    this._draw();
  }

  async _ask(now, t) {
    this.asked = { at: Date.now(), t };
    const ask = async (by, span) => (await getJson(`api/energy?by=${by}&from=${Math.round(now - span)}&until=${Math.round(now)}`)).rows;
    try {
      const [hour, day] = await Promise.all([ask("hour", DAY), ask("day", 30 * DAY)]);
      this.rows = { hour, day };
      this.failure = null;
    } catch (error) {
      this.failure = `The stored energy could not be read: ${error.message}`;
    }
    this._draw();
  }

  _draw() {
    if (!this.root.clientWidth || this.now === undefined) return;
    const { format: f, energy } = this;
    morph(this.root, h("div", {},
      h("div.sums", {}, [["today", "Today"], ["week", "This week"], ["total", "Since the start"]].map(([key, title]) => h("section", {},
        h("h3", {}, title, key === "total" && energy?.since ? h("span.muted", {}, `, ${f.date(energy.since)}`) : null),
        energy?.[key] ? energyParts(energy[key], f) : h("p.empty", {}, "No plan has been driven yet.")))),
      h("p.muted", {}, "Counted of plans. What vehicles save by their advice (approach to signals, coasting, priority) is not in it."),
      energy?.last_cycle ? h("section", {}, h("h3", {}, "The last cycle's plans, not driven yet"), energyParts(energy.last_cycle, f, true)) : null,
      this._charts(),
      this._report()));
  }

  _charts() {
    if (!this.history) return h("p.empty", {}, "No history is stored: there are no charts by hour and day.");
    if (this.failure) return h("p.empty", {}, this.failure);
    if (!this.rows) return h("p.muted", {}, "Loading…");
    const { format: f, now, rows } = this;
    const width = Math.max(280, this.root.clientWidth - 26);
    const show = (kwh) => f.measure(kwh);
    const bars = (title, all, step, span, time) => h("figure", { "data-key": title }, h("figcaption", {}, `${title}, kWh saved`),
      all.length ? barChart({ label: title, rows: all.map((row) => ({ t: row.t, parts: partsOf(row) })), step, from: now - span, until: now, width, show, time })
        : h("p.empty", {}, "Nothing is stored of this time."));
    let sum = 0;
    const added = rows.day.map((row) => (sum += row.saved_kwh ?? 0));
    return h("section", { "data-key": "charts" }, h("h3", {}, "Saved by distance, drag and acceleration"),
      bars("By hour", rows.hour, HOUR, DAY, (ms) => f.time(ms, ms)),
      bars("By day", rows.day, DAY, 30 * DAY, (ms) => f.day(ms)),
      rows.day.length ? h("figure", { "data-key": "sum" }, h("figcaption", {}, "Summed up over 30 days, kWh"), lineChart({
        label: "Saved energy summed up", t: rows.day.map((row) => Math.min(now, row.t + DAY)), values: added, from: now - 30 * DAY, until: now, width, show, time: (ms) => f.day(ms),
      })) : null);
  }

  _report() {
    if (!this.history) return null;
    const { format: f, now } = this;
    return h("form.line", { "data-report": true, "data-key": "report" },
      h("label", {}, "Report of ", h("input", { type: "date", name: "day", value: f.isoDay(now), max: f.isoDay(now), required: true })),
      h("button", { type: "submit" }, "Open"));
  }
}
