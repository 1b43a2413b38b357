/** What rows say of themselves by the clock, in words: silent vehicles, late orders. */

import { words } from "./format.js";

/** What a vehicle does; of a silent one since when it is not heard, and what it told last. @param {any} row @param {import("./format.js").Format} f */
export function doing(row, f, now = Date.now()) {
  if (row.state !== "silent") return row.text || words(row.state);
  return [row.seen === null ? "silent" : `silent since ${f.since(row.seen, now)}`, row.text].filter(Boolean).join("; ");
}

/** Why an order may not be served in time, each in words; none where nothing says so. @param {any} row @param {import("./format.js").Format} f @returns {string[]} */
export function doubts(row, f, now = Date.now()) {
  return [
    row.late_since === null || row.late_since === undefined ? null : `late since ${f.since(row.late_since, now)}`,
    row.silent_since === null || row.silent_since === undefined ? null : `vehicle silent since ${f.since(row.silent_since, now)}`,
  ].filter((text) => text !== null);
}
