/** Joins the parts of the page: what comes in goes into the store, and from it to whatever is in view. */

import { getJson } from "./api.js";
import { Actions } from "./actions.js";
import { Banner, faults } from "./banner.js";
import { setBoxes } from "./boxes.js";
import { CameraGrid } from "./cameras.js";
import { CardPanel } from "./card.js";
import { makeColumns } from "./columns.js";
import { byId, setText } from "./dom.js";
import { EnergyPanel } from "./energy.js";
import { saveRows } from "./export.js";
import { Format } from "./format.js";
import { counts, drawGlance } from "./glance.js";
import { Header } from "./header.js";
import { MapPanel, onMap } from "./map_panel.js";
import { showPictures } from "./pictures.js";
import { KINDS, Router, hashOf, parseSubject } from "./router.js";
import { Search } from "./search.js";
import { makeSplitter } from "./splitter.js";
import { Store } from "./store.js";
import { LiveStream } from "./stream.js";
import { Tabs } from "./tabs.js";
import { TimeBar } from "./time.js";

const RETRY_MS = 2000;

/** The page. */
class Page {
  constructor(config, network) {
    this.config = config;
    this.network = network;
    this.live = new Store();
    /** @type {Store|null} the past moment shown */
    this.past = null;
    this.connection = { up: !config.live, since: null, text: null };
    this.format = new Format(config);
    this.names = new Map(network.roads.map((road) => [road.id, road.name ?? road.id]));
    this.selection = null;
    this.failure = null;
    this._makeParts();
    this._listen();
  }

  /** What is shown. */
  get shown() { return this.past ?? this.live; }

  _makeParts() {
    const { config, format } = this;
    this.router = new Router(() => this._follow());
    this.banner = new Banner(byId("banner"), config.title && config.title !== "Slipstream" ? `${config.title} – Slipstream` : "Slipstream");
    this.header = new Header(config, format);
    this.tabs = new Tabs(makeColumns(format, { names: this.names, now: () => this._now() }), {
      onTab: (name) => this.openTab(name), onSelect: (kind, id) => this.select({ kind, id }),
    });
    this.card = new CardPanel(() => this._context());
    this.cameras = new CameraGrid(byId("pane-cameras"), format);
    this.energy = new EnergyPanel(byId("pane-energy"), format, config.history);
    this.actions = new Actions(() => this.live.tables.vehicles.keys());
    this.map = new MapPanel(this.network, config.units, {
      onSelect: (selection) => this.select(selection), now: () => this._now(), words: () => this._pictureWords(),
    });
    this.search = new Search(byId("search"), byId("found"), () => this._subjects(), (kind, id) => this.select({ kind, id }, { show: true, tab: true }));
    this.time = new TimeBar(format, config, {
      onMoment: (moment) => this._showPast(moment),
      onLive: () => {
        this.past = null;
        this._draw(null);
        this._address(false);
      },
      onFailure: (text) => { this.failure = text; this._drawBanner(); },
      onStay: () => this._address(false),
    });
    showPictures(format);
    makeSplitter(byId("splitter"), byId("main"));
  }

  _listen() {
    document.addEventListener("click", (event) => this._click(event));
    byId("card-close").addEventListener("click", () => this.select(null));
    byId("export-shown").addEventListener("click", () => this._export());
    byId("card-show").addEventListener("click", () => this.map.show());
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.selection && !document.querySelector("dialog[open]") && event.target === document.body) this.select(null);
    });
    addEventListener("submit", (event) => {
      const form = /** @type {HTMLFormElement} */ (event.target);
      if (!form.matches("[data-report]")) return;
      event.preventDefault();
      open(`report?day=${new FormData(form).get("day")}`, "_blank", "noopener");
    });
    addEventListener("change", (event) => {
      const box = /** @type {HTMLInputElement} */ (event.target);
      if (!box.matches("[data-boxes]")) return;
      setBoxes(box.checked);
      this.card.draw();
    });
    setInterval(() => this._tick(), 1000);
  }

  _tick() { this.header.tick(this.shown, this._now(), this._control()); }

  /** Begins: the stream, the past, and what the address says. */
  async start() {
    this._follow();
    if (this.config.live) {
      this.stream = new LiveStream("api/live", {
        onMoment: (moment) => this._take(this.live.setMoment(moment)),
        onDelta: (delta) => this._take(this.live.apply(delta)),
        onState: (up) => this._connected(up),
      });
    }
    if (!this.config.history) return;
    await this.time.refreshRange();
    const { t } = this.router.read();
    if (!this.config.live) await this.time.go(this.time.range.last ?? 0);
    if (t !== null) await this.time.go(t);
  }

  _take(changed) {
    if (!this.past) this._draw(changed);
    else this._drawBanner();
  }

  _connected(up) {
    if (up && this.connection.up) return;
    const since = up ? null : this.connection.since ?? Date.now();
    const text = up ? null : this.live.t === null ? "The server does not answer; trying again." : `The connection to the server is lost since ${this.format.clock(since)}; what is shown may be out of date.`;
    this.connection = { up, since, text };
    document.documentElement.dataset.connection = up ? "up" : this.live.t === null ? "none" : "lost";
    this._drawBanner();
    this._tick();
    this.card.draw();
  }

  _showPast(moment) {
    const store = new Store();
    store.setMoment(moment);
    this.past = store;
    this._draw(null);
    this._address(false);
  }

  _now() { return this.past?.t ?? Date.now(); }

  /** What stands over a picture of the map: whose it is, and the moment that it shows. */
  _pictureWords() {
    const { format: f } = this, now = this._now();
    return `${this.banner.title}, ${f.moment(now)} ${f.zone(now)}${this.past ? " (past)" : ""}`;
  }

  /** Whether the dispatcher can be asked for anything: the page may, it is heard, and the present is shown. */
  _control() { return this.config.control && this.past === null && this.connection.up && this.live.dispatcher_heard; }

  _context() {
    return {
      f: this.format, now: this._now(), t: this.past ? this.time.t : null, control: this._control(), tables: this.shown.tables,
      roadName: (road) => this.names.get(road) ?? road,
    };
  }

  /** Draws what has changed. @param {import("./store.js").Changed} changed */
  _draw(changed) {
    const { shown } = this;
    this.tabs.update(shown.tables, changed);
    drawGlance(byId("glance"), counts(shown, this.format));
    this._drawBanner();
    this._tick();
    this.map.update(shown.tables, changed);
    this._drawPane();
    const table = this.selection && KINDS[this.selection.kind].table;
    const control = this._control();
    this.card.refresh(changed === null || control !== this.offered || Boolean(table && changed[table]?.has(this.selection.id)));
    this.offered = control;
    this._drawExport();
    if (document.documentElement.dataset.ready) return;
    document.documentElement.dataset.ready = "1";
    performance.mark("content");
  }

  _drawPane() {
    const { shown } = this;
    this.cameras.show(shown.tables.rsus, this.tabs.name === "cameras", this.past !== null);
    if (this.tabs.name === "energy") this.energy.show(shown.energy, this._now(), this.past ? this.time.t : null);
  }

  _drawBanner() {
    const status = this.config.live ? this.live.status : this.shown.status;
    const items = faults(status, this.connection);
    this.banner.show(items, this.past !== null && this.config.live, this.failure);
  }

  _drawExport() {
    byId("export-table").href = this._exportUrl();
    byId("export-shown").hidden = !this.tabs.ids;
  }

  /** Saves the rows of the open table as they are shown. */
  async _export() {
    try {
      await saveRows(this._exportUrl(), this.tabs.ids ?? []);
      this.failure = null;
    } catch (error) {
      this.failure = `The table could not be saved: ${error.message}`;
    }
    this._drawBanner();
  }

  _exportUrl() {
    const t = this.past ? `?t=${Math.round(this.time.t ?? 0)}` : "";
    return `api/export/${this.tabs.name === "cameras" ? "rsus" : this.tabs.name}.csv${t}`;
  }

  _click(event) {
    const target = /** @type {Element} */ (event.target);
    const button = target.closest("button[data-action]");
    const goal = target.closest("[data-go]");
    const tab = target.closest("[data-tab]");
    if (button) this.actions.ask(button.getAttribute("data-action"), button.getAttribute("data-subject"), button.getAttribute("data-vehicle"), button.getAttribute("data-only"));
    else if (goal && !event.ctrlKey && !event.metaKey) {
      event.preventDefault();
      this.select(parseSubject(goal.getAttribute("data-go")), { show: true });
    } else if (tab?.hasAttribute("data-filter")) this.tabs.openFiltered(tab.getAttribute("data-tab"), tab.getAttribute("data-filter"));
    else if (tab) this.openTab(tab.getAttribute("data-tab"));
    for (const menu of document.querySelectorAll("details.menu[open]")) if (!menu.contains(target) || button) menu.removeAttribute("open");
  }

  /** @param {string} name */
  openTab(name) {
    this.tabs.open(name);
    this.tabs.update(this.shown.tables, null);
    this._drawPane();
    this._drawExport();
    this._address(false);
  }

  /** @param {{kind: string, id: string}|null} selection */
  select(selection, { show = false, tab = false } = {}) {
    this._selectOnly(selection);
    this._address(true);
    if (tab && selection) this.openTab(KINDS[selection.kind].table);
    if (show) this.map.show();
  }

  _selectOnly(selection) {
    this.selection = selection;
    byId("main").classList.toggle("with-card", selection !== null);
    this.card.select(selection);
    this.tabs.select(selection);
    byId("card-show").hidden = !onMap(selection);
    this.map.select(selection);
    this.header.link(selection);
  }

  _address(push) {
    this.router.write({ selection: this.selection, tab: this.tabs.name, t: this.past ? this.time.t : null }, push);
  }

  _follow() {
    const { selection, tab, t } = this.router.read();
    this.tabs.open(tab ?? "vehicles");
    this.tabs.update(this.shown.tables, null);
    this._drawPane();
    if (hashOf(selection) !== hashOf(this.selection)) {
      this._selectOnly(selection);
      this.map.show();
    }
    if (t === null && this.past) this.time.goLive();
    else if (t !== null && t !== this.time.t) this.time.go(t);
  }

  *_subjects() {
    const { tables } = this.shown;
    for (const id of tables.vehicles.keys()) yield { kind: "vehicle", id, name: id };
    for (const [id, name] of this.names) yield { kind: "road", id, name };
    for (const id of tables.rsus.keys()) yield { kind: "rsu", id, name: id };
    for (const id of tables.orders.keys()) yield { kind: "order", id, name: id };
    for (const id of tables.cycles.keys()) yield { kind: "cycle", id, name: `cycle ${id}` };
  }
}

async function begin() {
  for (;;) {
    try {
      const [config, network] = await Promise.all([getJson("api/config"), getJson("api/network")]);
      const page = new Page(config, network);
      await page.start();
      return;
    } catch (error) {
      if (!(error instanceof TypeError) && !error.status) throw error;
      const banner = byId("banner");
      banner.hidden = false;
      banner.dataset.level = "bad";
      setText(banner, `The server does not answer: ${error.message}. Trying again.`);
      await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
    }
  }
}

begin();
