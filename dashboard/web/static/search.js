/** Search over everything that has a name, by `/`. */

import { h, morph } from "./dom.js";
import { KINDS } from "./router.js";

const FIRST_RESULTS = 12;
const MORE_RESULTS = 200;

/**
 * Finds subjects by name: the same name first, then names that begin with the text, then names that hold it; of both, names before IDs.
 * @param {string} text
 * @param {Iterable<{kind: string, id: string, name: string}>} subjects
 */
export function find(text, subjects) {
  const wanted = text.trim().toLowerCase();
  if (!wanted) return [];
  const found = [];
  for (const subject of subjects) {
    const id = subject.id.toLowerCase();
    const name = subject.name.toLowerCase();
    const rank = id === wanted || name === wanted ? 0 : name.startsWith(wanted) ? 1 : id.startsWith(wanted) ? 2
      : name.includes(wanted) ? 3 : id.includes(wanted) ? 4 : -1;
    if (rank >= 0) found.push({ ...subject, rank });
  }
  const natural = new Intl.Collator("en", { numeric: true });
  return found.sort((a, b) => a.rank - b.rank || natural.compare(a.name, b.name) || natural.compare(a.id, b.id));
}

/** The search field with its list of results. */
export class Search {
  /**
   * @param {HTMLInputElement} input
   * @param {HTMLElement} list
   * @param {() => Iterable<{kind: string, id: string, name: string}>} subjects
   * @param {(kind: string, id: string) => void} onChoose
   */
  constructor(input, list, subjects, onChoose) {
    this.input = input;
    this.list = list;
    this.subjects = subjects;
    this.onChoose = onChoose;
    /** @type {any[]} */
    this.found = [];
    this.limit = FIRST_RESULTS;
    this.active = 0;
    input.addEventListener("input", () => {
      this.limit = FIRST_RESULTS;
      this.active = 0;
      this._draw();
    });
    input.addEventListener("keydown", (event) => this._key(event));
    input.addEventListener("blur", () => setTimeout(() => this._close(), 150));
    list.addEventListener("pointerdown", (event) => event.preventDefault());
    list.addEventListener("click", (event) => {
      const option = /** @type {Element} */ (event.target).closest("[data-place]");
      if (option) this._choose(Number(option.getAttribute("data-place")));
    });
    addEventListener("keydown", (event) => {
      const target = /** @type {Element} */ (event.target);
      if (event.key !== "/" || target.closest?.("input, textarea, select, dialog")) return;
      event.preventDefault();
      input.focus();
      input.select();
    });
  }

  _draw() {
    this.found = find(this.input.value, this.subjects());
    const shown = this.found.slice(0, this.limit);
    const more = this.found.length - shown.length;
    const options = shown.map((subject, place) => this._option(place, KINDS[subject.kind].noun, subject.id, subject.name));
    if (more > 0) options.push(this._option(shown.length, "", `and ${more.toLocaleString("en-GB")} more`, ""));
    if (!shown.length) options.push(h("li.empty", { role: "option", "aria-disabled": "true", "aria-selected": "false" }, "Nothing has this name."));
    const open = this.input.value.trim() !== "";
    morph(this.list, h("ul", {}, options));
    this.list.hidden = !open;
    this.input.setAttribute("aria-expanded", String(open));
    if (open && shown.length) this.input.setAttribute("aria-activedescendant", `found-${this.active}`);
    else this.input.removeAttribute("aria-activedescendant");
    this.list.querySelector("[aria-selected=true]")?.scrollIntoView({ block: "nearest" });
  }

  _option(place, noun, id, name) {
    return h("li", { role: "option", id: `found-${place}`, "data-place": place, "aria-selected": String(place === this.active) },
      // People know a street by its name; its ID tells its parts apart.
      h("span.name", {}, name || id), name && !name.includes(id) ? h("span.muted", { title: id }, id) : null, h("span.kind", {}, noun));
  }

  _key(event) {
    const last = Math.min(this.found.length, this.limit + 1) - 1;
    if (event.key === "ArrowDown") this.active = Math.min(last, this.active + 1);
    else if (event.key === "ArrowUp") this.active = Math.max(0, this.active - 1);
    else if (event.key === "Enter") return this._choose(this.active);
    else if (event.key === "Escape") {
      this.input.value = "";
      this.input.blur();
    } else return;
    event.preventDefault();
    this._draw();
  }

  _choose(place) {
    if (place >= this.limit && this.found.length > this.limit) {
      this.limit += MORE_RESULTS;
      this._draw();
      return;
    }
    const subject = this.found[place];
    if (!subject) return;
    this.input.value = "";
    this._close();
    this.input.blur();
    this.onChoose(subject.kind, subject.id);
  }

  _close() {
    this.list.hidden = true;
    this.input.setAttribute("aria-expanded", "false");
    this.input.removeAttribute("aria-activedescendant");
  }
}
