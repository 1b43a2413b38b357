/** A roadside unit's card: its picture, its figures, its faults and its calibration. */

import { boxSwitch } from "../boxes.js";
import { h } from "../dom.js";
import { count, words } from "../format.js";
import { chip } from "../marks.js";
import { pictureParts } from "../pictures.js";
import { facts, links, section, tile } from "./parts.js";

/** @param {string} id @param {any} row @param {any} detail @param {import("./parts.js").CardContext} ctx */
export function rsuCard(id, row, detail, ctx) {
  const { f } = ctx;
  const told = ctx.t !== null ? "not stored" : "not known";
  const counted = detail?.frames !== null && detail?.frames !== undefined;
  return [
    h("div.lead", {}, chip(row.level, row.why || words(row.status))),
    picture(id, row, ctx),
    h("div.tiles", {},
      tile("Frames/s", f.number(row.fps, 1)),
      tile("Latency", row.latency_ms === null ? "–" : `${f.number(row.latency_ms)}\u00a0ms`),
      tile("Skipped", f.share(row.skipped_share)),
      tile("Vehicles", f.number(row.vehicles))),
    facts([
      ["Faults", !row.faults ? told : row.faults.length ? row.faults.map(words).join(", ") : "none"],
      ["Watches", h("span", {}, links("road", row.segments, ctx.roadName))],
      ["Last heard", heard(row, ctx)],
      ...(detail ? [
        ["Source", detail.source],
        ["Running since", detail.started === null ? told : f.moment(detail.started)],
        ["Frames", !counted ? told : `${f.number(detail.frames)}, ${f.number(detail.repeated)} repeated, ${count(detail.decode_errors ?? 0, "decode error")}`],
        ["Reconnects", counted ? f.number(detail.reconnects) : told],
        ["Memory", detail.rss_mb === null ? null : `${f.number(detail.rss_mb)}\u00a0MB`],
      ] : []),
    ]),
    detail ? section("Calibration", detail.calibration ? calibration(detail.calibration, f) : h("p.muted", {}, ctx.t !== null ? "It is not stored." : counted ? "This unit's version does not tell it." : "It is not known: the unit was never heard.")) : null,
    detail?.reception ? section("Reception", facts([
      ["Messages", f.number(detail.reception.received)],
      ["Missed", f.number(detail.reception.missed)],
      ["Twice", f.number(detail.reception.duplicates)],
      ["Out of order", f.number(detail.reception.out_of_order)],
      ["Delay", detail.reception.delay_s === null ? null : `${f.number(detail.reception.delay_s, 2)}\u00a0s`],
    ])) : null,
  ];
}

/** Of a past moment only the states of its minute are stored. */
const IN_ITS_MINUTE = { silent: "not in this minute", "not known": "not stored" };

function heard(row, ctx) {
  if (ctx.t !== null) return IN_ITS_MINUTE[row.status] ?? "in this minute";
  if (row.seen !== null) return ctx.f.moment(row.seen);
  return row.fps === null ? "never" : "now, as each second";
}

/** Beyond this relative error of speed `slipstream calibrate` warns too. */
const MAX_SPEED_ERROR = 0.03;

function calibration(told, f) {
  const known = told.speed_error !== null;
  const sure = known && told.speed_error <= MAX_SPEED_ERROR;
  return [
    h("div.lead", {}, chip(sure ? "ok" : "warn", known ? `speeds within ±${f.share(told.speed_error)}` : "speed error unknown")),
    facts([
      ["Residual", `${f.number(told.residual_px, 2)}\u00a0px over ${count(told.points, "point")}`],
      ["Written", f.moment(told.written)],
      ["File", told.file],
    ]),
  ];
}

function picture(id, row, ctx) {
  if (ctx.t !== null) return h("p.muted", {}, "Pictures are not stored: there is none of a past moment.");
  if (!row.picture) return h("p.empty.picture", {}, "It sends no picture.");
  // What the picture shows is kept up beside the card.
  return h("figure.picture", { "data-key": id, "data-picture": id, "data-keep": true }, pictureParts(id),
    h("figcaption", {}, boxSwitch()));
}
