/** A vehicle's card: where it is, its plan as a timeline, and why it drives this way and with whom. */

import { h } from "../dom.js";
import { words } from "../format.js";
import { doing } from "../judged.js";
import { chip, swatch } from "../marks.js";
import { timeline } from "../timeline.js";
import { facts, link, links, longTable, section, sentences, tile } from "./parts.js";

const SOURCES = { reported: "reported by the vehicle", planned: "by plan: the vehicle reports none" };

/** @param {string} id @param {any} row @param {any} detail @param {import("./parts.js").CardContext} ctx */
export function vehicleCard(id, row, detail, ctx) {
  const { f, now } = ctx;
  const plan = detail?.plan;
  return [
    h("div.lead", {}, swatch(row.colour, row.source), chip(row.level, doing(row, f, now))),
    h("div.tiles", {},
      tile("Next stop", row.next ?? "none"),
      tile(row.source === "reported" ? "ETA" : "ETA by plan", f.time(row.eta, now)),
      tile("Delay", f.delay(row.delay_s)),
      tile("Stops left", f.number(row.stops_left))),
    facts([
      ["Place", row.source === "last" ? `where it was heard last, ${f.duration((now - row.seen) / 1000)} ago` : SOURCES[row.source] ?? "unknown"],
      ["Road", row.road ? link("road", row.road, ctx.roadName(row.road)) : null],
      ["Platoon", row.platoon ? h("span", {}, row.platoon, row.place === null ? "" : `, place ${row.place + 1}`, row.source === "reported" ? "" : ", by plan") : row.source === "reported" ? "drives alone" : "not known"],
      row.with?.length ? ["Partners", h("span", {}, links("vehicle", row.with.filter((other) => other !== id)))] : null,
      ["Carrier", row.carrier],
      ["Battery", row.charge_kwh === null ? null : f.kwh(row.charge_kwh)],
      ["Its tour", row.km === null ? null : `${f.km(row.km)}, ${f.km(row.platoon_km)} in platoons`],
      ["Cycle", row.cycle === null ? null : link("cycle", String(row.cycle))],
    ]),
    plan ? planParts(plan, row, ctx) : section("Plan", h("p.muted", {}, detail ? "It has no plan now." : "Loading…")),
    detail ? [
      section("Why this route", sentences(detail.why_route, "The plan gives no reason for its route.")),
      section("Why this platoon", sentences(detail.why_platoon, row.platoon ? "The plan gives no reason." : "Its plan has no platoon, and no other vehicle comes its way in time.")),
      detail.history?.length ? section("Plans before", longTable(["#Cycle", "Issued", "Answer", "Reason"], detail.history.map((past) => [
        link("cycle", String(past.cycle)), f.time(past.issued, now), words(past.status), past.reason ?? "–",
      ]), "Plans before", 5)) : null,
    ] : null,
  ];
}

function planParts(plan, row, ctx) {
  const { f, now } = ctx;
  const time = (ms) => f.time(ms, now);
  const together = plan.segments.filter((part) => part.platoon);
  return [
    section("Plan",
      timeline(plan, { now, width: ctx.width, time }),
      h("p.key", {}, h("span.key-drive", {}, "driving"), h("span.key-platoon", {}, "in a platoon"), h("span.key-stop", {}, "at a stop"), h("span.key-window", {}, "time window, by the stop's number")),
      plan.stops.length ? longTable(["#", "Stop", "#Arrival", "#Leaves", "#Window", "State"], plan.stops.map((stop, i) => [
        i + 1, ctx.tables.orders.has(stop.id) ? link("order", stop.id) : stop.id, time(stop.arrival), time(stop.departure), f.window(stop.earliest, stop.latest, now),
        [words(stop.state), stop.wait_s > 0 ? `, waits ${f.duration(stop.wait_s)}` : "", stop.charged_kwh ? `, charges ${f.kwh(stop.charged_kwh)}` : ""].join(""),
      ]), "Stops", 12) : h("p.muted", {}, "No stops.")),
    section("Energy", energyOf(plan, row, f)),
    together.length ? section("In platoons", longTable(["Road", "#From", "#To", "Platoon", "#Place", "#Gap"], together.map((part) => [
      link("road", part.road, ctx.roadName(part.road)), f.clock(part.entry), f.clock(part.exit), part.platoon, (part.place ?? 0) + 1, part.gap_m === null ? "leads" : f.distance(part.gap_m),
    ]), "Roads in platoons", 6)) : null,
    facts([
      ["Issued", f.moment(plan.issued)],
      ["Departs", time(plan.depart)],
      ["Valid until", time(plan.valid_until)],
    ]),
  ];
}

function energyOf(plan, row, f) {
  const alone = plan.alone_kwh ?? null;
  const saved = alone === null ? row.saved_kwh ?? null : alone - plan.energy_kwh;
  // Platoons save some hundredths: the digits of one have to fit the others.
  const kwh = (value) => `${f.number(value, 3)}\u00a0kWh`;
  return h("div.tiles", {},
    tile("This plan", kwh(plan.energy_kwh)),
    alone === null ? null : tile("Alone", kwh(alone), "the same drive"),
    saved === null ? null : tile("To save", kwh(saved), alone ? f.share(saved / alone) : ""));
}
