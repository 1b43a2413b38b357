/** The map's place in the page: it comes after the tables, as it takes longer to load and to draw. */

import { byId } from "./dom.js";

const KINDS = new Set(["vehicle", "road", "rsu", "order"]);

/** Whether a selection can be shown on the map. @param {{kind: string, id: string}|null} selection */
export function onMap(selection) { return selection !== null && KINDS.has(selection.kind); }

/** Holds the map, and what it has to show once it is there. */
export class MapPanel {
  /**
   * @param {any} network
   * @param {"metric"|"imperial"} units
   * @param {{onSelect: (selection: {kind: string, id: string}|null) => void, now: () => number, words: () => string}} from
   *   takes what is clicked; gives the moment shown, and the words over a picture of it
   */
  constructor(network, units, { onSelect, now, words }) {
    this.network = network;
    this.units = units;
    this.onSelect = onSelect;
    this.now = now;
    this.words = words;
    /** @type {{kind: string, id: string}|null} */
    this.selection = null;
    addEventListener("themechange", () => this._theme());
    byId("export-map").addEventListener("click", () => this._export());
  }

  /** @param {import("./store.js").Tables} tables @param {import("./store.js").Changed} changed */
  update(tables, changed) {
    const first = !this.tables;
    this.tables = tables;
    if (first) setTimeout(() => this._load(), 0);
    else this.map?.setMoment(tables, changed);
  }

  async _load() {
    const { CityMap } = await import("./map/map.js");
    this.map = new CityMap(byId("map"), {
      onSelect: (kind, id) => this.onSelect(kind ? { kind, id } : null),
      reducedMotion: matchMedia("(prefers-reduced-motion: reduce)").matches,
      units: this.units,
    });
    this._theme();
    this.map.setNetwork(this.network);
    this.map.setMoment(this.tables, null);
    this.select(this.selection);
    this.show();
    document.documentElement.dataset.map = "1";
  }

  /** @param {{kind: string, id: string}|null} selection */
  select(selection) {
    this.selection = selection;
    if (selection && onMap(selection)) this.map?.select(selection.kind, selection.id);
    else this.map?.select(null);
  }

  /** Brings what is selected into view. */
  show() {
    if (this.selection && onMap(this.selection)) this.map?.show(this.selection.kind, this.selection.id);
  }

  _theme() { this.map?.setTheme(document.documentElement.dataset.theme === "dark" ? "dark" : "light"); }

  async _export() {
    if (!this.map) return;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await this.map.toPNG({ text: this.words() }));
    link.download = `slipstream-map-${new Date(this.now()).toISOString().slice(0, 19).replaceAll(":", "")}Z.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }
}
