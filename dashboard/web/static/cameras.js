/** The camera grid: pictures of the units that the reader chooses. */

import { boxSwitch } from "./boxes.js";
import { h, setText } from "./dom.js";
import { levelMark, levelRank } from "./marks.js";
import { pictureParts, release } from "./pictures.js";

const KEY = "slipstream.cameras";
const FIRST = 6;

/** Tiles with pictures and a list to choose from. */
export class CameraGrid {
  /** @param {HTMLElement} root @param {import("./format.js").Format} format */
  constructor(root, format) {
    this.format = format;
    this.chosen = read();
    this.rows = new Map();
    /** @type {Map<string, HTMLElement>} */
    this.tiles = new Map();
    this.open = false;
    this.past = false;
    this.summary = h("summary", {}, "Choose cameras");
    this.choice = h("div.choice", {});
    this.grid = h("div.cameras", {});
    this.note = h("p.empty", { hidden: true });
    root.replaceChildren(h("details.choose", {}, this.summary, this.choice), boxSwitch(), this.note, this.grid);
    this.choice.addEventListener("change", (event) => this._choose(/** @type {HTMLInputElement} */ (event.target)));
  }

  /** @param {Map<string, any>} rows @param {boolean} open whether the tab is shown @param {boolean} past */
  show(rows, open, past) {
    Object.assign(this, { rows, open, past });
    if (!open) return;
    const all = [...rows].filter(([, row]) => row.picture).sort(([a, one], [b, other]) => levelRank(one.level) - levelRank(other.level) || a.localeCompare(b, "en", { numeric: true }));
    const ids = all.map(([id]) => id);
    const wanted = (this.chosen ?? ids.slice(0, FIRST)).filter((id) => rows.has(id));
    setText(this.summary, `Choose cameras: ${wanted.length} of ${ids.length} shown`);
    this.note.hidden = wanted.length > 0 && !past;
    setText(this.note, past ? "Pictures are not stored: there are none of a past moment." : ids.length ? "No camera is chosen." : "No roadside unit sends pictures.");
    this._drawChoice(ids, wanted);
    this._drawTiles(past ? [] : wanted);
  }

  _drawChoice(ids, wanted) {
    const key = ids.join();
    if (this.choices !== key) {
      this.choices = key;
      this.choice.replaceChildren(...ids.map((id) => h("label", {}, h("input", { type: "checkbox", value: id }), ` ${id}`)));
    }
    for (const box of this.choice.querySelectorAll("input")) box.checked = wanted.includes(box.value);
  }

  _drawTiles(wanted) {
    for (const [id, tile] of this.tiles) {
      if (wanted.includes(id)) continue;
      release(/** @type {HTMLImageElement} */ (tile.querySelector("img")));
      tile.remove();
      this.tiles.delete(id);
    }
    for (const id of wanted) {
      const row = this.rows.get(id);
      let tile = this.tiles.get(id);
      if (!tile) {
        tile = h("figure.camera", { "data-picture": id }, pictureParts(id),
          h("figcaption", {}, h("span.mark", {}), h("a", { href: "#", "data-go": `rsu/${id}` }, id), h("span.muted.how", {})));
        this.tiles.set(id, tile);
      }
      const mark = /** @type {HTMLElement} */ (tile.querySelector(".mark"));
      if (mark.dataset.level !== row.level) {
        mark.dataset.level = row.level;
        mark.replaceChildren(levelMark(row.level));
      }
      setText(/** @type {Element} */ (tile.querySelector(".how")), row.why ?? `${this.format.number(row.fps, 0)} frames/s`);
      if (tile.parentNode !== this.grid) this.grid.append(tile);
    }
  }

  _choose(box) {
    const shown = new Set([...this.choice.querySelectorAll("input:checked")].map((one) => /** @type {HTMLInputElement} */ (one).value));
    if (!box.checked) shown.delete(box.value);
    this.chosen = [...shown];
    localStorage.setItem(KEY, JSON.stringify(this.chosen));
    this.show(this.rows, this.open, this.past);
  }
}

function read() {
  try {
    const chosen = JSON.parse(localStorage.getItem(KEY) ?? "null");
    return Array.isArray(chosen) ? chosen.map(String) : null;
  } catch {
    return null;
  }
}
