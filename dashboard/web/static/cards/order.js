/** An order's card: its state, its window, what became of it, and what may be done with it. */

import { h } from "../dom.js";
import { words } from "../format.js";
import { doubts } from "../judged.js";
import { chip } from "../marks.js";
import { actionButton, facts, link, longTable, section, tile } from "./parts.js";

/** States in which a caller's order can be cancelled; one of the fleet's file is taken out of the file. */
const CANCELLED = new Set(["open", "planned"]);
const ENDED = new Set(["served", "failed", "cancelled"]);

function late(row, f, now) {
  if (row.late_s > 0) return f.delay(row.late_s);
  if (row.late_since) return `since ${f.since(row.late_since, now)}`;
  return row.silent_since || row.level === "idle" ? "not known" : "no";
}

/** @param {string} id @param {any} row @param {any} detail @param {import("./parts.js").CardContext} ctx */
export function orderCard(id, row, detail, ctx) {
  const { f, now } = ctx;
  return [
    h("div.lead", {}, chip(row.level, [words(row.state), ...doubts(row, f, now)].join(", ")), row.pinned ? chip("idle", "locked to its vehicle") : null),
    h("div.tiles", {},
      tile("ETA", f.time(row.eta, now)),
      tile("Window", f.window(row.earliest, row.latest, now)),
      tile("Late", late(row, f, now))),
    ctx.control && !ENDED.has(row.state) ? h("div.buttons", {},
      row.pinned ? actionButton("Release", { action: "release", subject: `order/${id}` })
        : actionButton("Lock to a vehicle", { action: "pin", subject: `order/${id}`, vehicle: row.vehicle, only: row.state === "under_way" ? row.vehicle : null }),
      CANCELLED.has(row.state) && row.source === "api" ? actionButton("Cancel the order", { action: "cancel", subject: `order/${id}` }) : null) : null,
    facts([
      ["Vehicle", row.vehicle ? link("vehicle", row.vehicle) : "none yet"],
      ["Why", row.why],
      ["Place", row.node],
      ["Source", row.source],
      ["Since", f.moment(row.since)],
      ["Demand", detail?.demand === null || detail?.demand === undefined ? null : String(detail.demand)],
      ["Mass", detail?.mass_kg === null || detail?.mass_kg === undefined ? null : f.mass(detail.mass_kg)],
      ["Service time", detail?.service_s === null || detail?.service_s === undefined ? null : f.duration(detail.service_s)],
      ["Skills", detail?.skills?.length ? detail.skills.join(", ") : null],
    ]),
    section("History", detail?.history?.length ? longTable(["#Time", "State", "Vehicle", "#Cycle", "Reason"], detail.history.map((one) => [
      f.time(one.t, now), words(one.state), one.vehicle ? link("vehicle", one.vehicle) : "–", one.cycle === null ? "–" : link("cycle", String(one.cycle)), one.reason ?? "–",
    ]), "History", 10) : h("p.muted", {}, detail ? "Nothing is stored of it." : "Loading…")),
  ];
}
