/** The banner: what is wrong now, worst first. */

import { h, icon, morph } from "./dom.js";
import { levelMark, levelRank } from "./marks.js";
import { hashOf, parseSubject } from "./router.js";

/**
 * What is wrong: the page's own connection before what the server knows.
 * @param {any} status the server's Status, or null
 * @param {{up: boolean, since: number|null, text: string|null}} connection
 * @returns {{subject: string, level: string, text: string}[]} worst first
 */
export function faults(status, connection) {
  const items = (status?.items ?? []).filter((item) => item.level === "bad" || item.level === "warn");
  if (!items.length && status?.count > 0) items.push({ subject: "", level: status.level ?? "bad", text: status.text });
  items.sort((a, b) => levelRank(a.level) - levelRank(b.level));
  if (!connection.up) {
    items.unshift({ subject: "page", level: "bad", text: connection.text ?? "Connecting to the server." });
  }
  return items;
}

/** Shows faults, and their count in the title of the browser's tab. */
export class Banner {
  /** @param {HTMLElement} root @param {string} title */
  constructor(root, title) {
    this.root = root;
    this.title = title;
    this.open = false;
    this.shown = "";
    /** @type {Parameters<Banner["show"]>} */
    this.told = [[]];
    root.addEventListener("click", (event) => {
      if (!(/** @type {Element} */ (event.target).closest("[data-more]"))) return;
      this.open = !this.open;
      this.shown = "";
      this.show(...this.told);
    });
  }

  /**
   * @param {{subject: string, level: string, text: string}[]} items
   * @param {boolean} past whether the page shows another moment than the faults'
   * @param {string|null} told the answer to what the reader asked for: it stands alone, whatever else is wrong
   */
  show(items, past = false, told = null) {
    this.told = [items, past, told];
    const key = JSON.stringify([items, this.open, past, told]);
    // An alert is read aloud at each change: none where nothing has changed.
    if (key === this.shown) return;
    this.shown = key;
    document.title = items.length ? `(${items.length.toLocaleString("en-GB")}) ${this.title}` : this.title;
    this.root.hidden = items.length === 0 && !told;
    this.root.dataset.level = items[0]?.level ?? "warn";
    if (!items.length) this.open = false;
    const [first, ...others] = items;
    morph(this.root, h("div", {}, told && h("p.told", {}, told), first && h("div.worst", {}, icon("alarm"), past ? "Now: " : null, line(first),
      others.length ? h("button.link", { type: "button", "data-more": true, "aria-expanded": String(this.open) },
        this.open ? "show the worst only" : `and ${others.length.toLocaleString("en-GB")} more`) : null),
    this.open ? h("ul.others", { tabindex: "0", "aria-label": "Everything that is wrong" }, others.map((item) => h("li", {}, levelMark(item.level), " ", line(item)))) : null));
  }
}

function line(item) {
  const selection = parseSubject(item.subject);
  if (!selection) return h("span", {}, item.text);
  // An alarm's text need not say whose it is.
  const text = item.text.includes(selection.id) ? item.text : `${selection.id}: ${item.text}`;
  return h("a", { href: hashOf(selection), "data-go": item.subject }, text);
}
