/** Signs of levels, flags and vehicles. None is told by its colour alone. */

import { h, s } from "./dom.js";

export const LEVELS = ["bad", "warn", "ok", "idle"];
const LEVEL_SIGN = { bad: "■", warn: "▲", ok: "●", idle: "○" };
const LEVEL_WORD = { bad: "fault", warn: "warning", ok: "well", idle: "idle" };
export const FLAG_SIGN = { stable: "✓", turbulent: "✕", unknown: "?" };
const SEVERITY_LEVEL = { critical: "bad", warning: "warn", info: "idle" };

/** A level's place, worst first. @param {string} level */
export function levelRank(level) {
  const place = LEVELS.indexOf(level);
  return place < 0 ? LEVELS.length : place;
}

/** @param {string} level */
export function levelSign(level) { return LEVEL_SIGN[level] ?? LEVEL_SIGN.idle; }

/** @param {string} level */
export function levelWord(level) { return LEVEL_WORD[level] ?? LEVEL_WORD.idle; }

/** @param {string} severity */
export function severityLevel(severity) { return SEVERITY_LEVEL[severity] ?? "idle"; }

/** The sign of a level, named for who cannot see it. @param {string} level */
export function levelMark(level) {
  return h("span.level", { "data-level": level, role: "img", "aria-label": levelWord(level) }, levelSign(level));
}

/** A word on a ground of its level. @param {string} level @param {string} text */
export function chip(level, text) {
  return h("span.chip", { "data-level": level }, h("span", { "aria-hidden": "true" }, levelSign(level)), ` ${text}`);
}

/** The flag of a road as sign and word. @param {string|null} flag */
export function flagChip(flag) {
  const known = flag ?? "unknown";
  return h("span.flag", { "data-flag": known }, `${FLAG_SIGN[known] ?? "?"} ${known}`);
}

const SHAPES = [
  () => s("circle", { cx: 6, cy: 6, r: 5 }),
  () => s("path", { d: "M1.5 1.5h9v9h-9z" }),
  () => s("path", { d: "M6 .8 11.4 10.6H.6z" }),
  () => s("path", { d: "M6 .3 11.7 6 6 11.7.3 6z" }),
];

/** A vehicle's colour and shape; hollow where its place is by plan only. @param {number} colour @param {string|null} source */
export function swatch(colour, source = "reported") {
  const index = Math.abs(colour ?? 0) % 12;
  const hollow = source === "reported" ? "" : ".hollow";
  return s(`svg.swatch.v${index}${hollow}`, { viewBox: "0 0 12 12", "aria-hidden": "true" }, SHAPES[index % SHAPES.length]());
}
