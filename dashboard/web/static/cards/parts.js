/** What the cards are made of. Cards are pure: values in, nodes out. */

import { h } from "../dom.js";
import { KINDS, hashOf } from "../router.js";

/**
 * @typedef {Object} CardContext
 * @property {import("../format.js").Format} f
 * @property {number} now the moment shown, ms
 * @property {number|null} t the same if it is a past one
 * @property {boolean} control whether actions may be asked for
 * @property {number} width px for charts
 * @property {(road: string) => string} roadName
 * @property {import("../store.js").Tables} tables
 */

/** A link to a subject. @param {string} kind @param {string|null} id @param {string} [text] */
export function link(kind, id, text = id ?? "–") {
  if (id === null || id === undefined) return "–";
  return h("a", { href: hashOf({ kind, id }), "data-go": `${KINDS[kind].hash}/${id}` }, text);
}

/** Links with commas between them. */
export function links(kind, ids, text = (id) => id) {
  if (!ids?.length) return "–";
  return ids.flatMap((id, i) => (i ? [", ", link(kind, id, text(id))] : [link(kind, id, text(id))]));
}

/** Names and values in two columns; pairs whose value is null are left out. @param {any[]} pairs */
export function facts(pairs) {
  return h("dl.facts", {}, pairs.filter((pair) => pair && pair[1] !== null && pair[1] !== undefined).map(([name, value]) => [
    h("dt", {}, name), h("dd", {}, value),
  ]));
}

/** A headed part of a card. @param {string} title */
export function section(title, ...children) {
  return h("section", { "data-key": title }, h("h3", {}, title), children);
}

/** A short table; a column beginning with "#" holds figures. @param {string[]} heads @param {any[][]} rows */
export function smallTable(heads, rows, label) {
  const figure = heads.map((head) => head.startsWith("#"));
  return h("div.wide", { tabindex: "0", role: "group", "aria-label": label }, h("table.small", {},
    h("thead", {}, h("tr", {}, heads.map((head, i) => h(figure[i] ? "th.num" : "th", { scope: "col" }, head.replace(/^#/, ""))))),
    h("tbody", {}, rows.map((row) => h("tr", {}, row.map((value, i) => h(figure[i] ? "td.num" : "td", {}, value)))))));
}

/** Some rows at once, the others behind a line that says how many. */
export function longTable(heads, rows, label, first = 8) {
  if (rows.length <= first) return smallTable(heads, rows, label);
  return [smallTable(heads, rows.slice(0, first), label), h("details", {}, h("summary", {}, `and ${rows.length - first} more`), smallTable(heads, rows.slice(first), `${label}, continued`))];
}

/** Sentences as a list. @param {string[]|null|undefined} lines */
export function sentences(lines, none) {
  return lines?.length ? h("ul.plain", {}, lines.map((text) => h("li", {}, text))) : h("p.muted", {}, none);
}

/** A button that asks for an action. @param {Object<string, string|null>} data */
export function actionButton(text, data) {
  return h("button", { type: "button", ...Object.fromEntries(Object.entries(data).map(([key, value]) => [`data-${key}`, value])) }, text);
}

/** A figure with its name. */
export function tile(name, value, note = "") {
  return h("div.tile", {}, h("span.name", {}, name), h("span.value.num", {}, value), note ? h("span.note", {}, note) : null);
}
