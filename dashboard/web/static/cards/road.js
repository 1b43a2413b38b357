/** A watched road's card: its flag and why, six features with their intervals over the last hour, who was refused here. */

import { h } from "../dom.js";
import { words } from "../format.js";
import { flagStrip, lineChart } from "../chart.js";
import { chip, flagChip } from "../marks.js";
import { facts, link, links, longTable, section, smallTable } from "./parts.js";

const HOUR_MS = 3_600_000;
/** 95 % of a normal distribution lies within this many standard errors. */
const INTERVAL = 1.96;
/** Series of the last hour, in the order of the paper's features. */
const SERIES = [
  ["kmh", "Mean speed"],
  ["acceleration", "Mean acceleration, m/s²"],
  ["density", "Density, vehicles/km"],
  ["headway", "Mean gap, m"],
  ["cv", "Spread of speed, share of the mean"],
  ["variance", "Variance of acceleration, m²/s⁴"],
];

/** @param {string} id @param {any} row @param {any} detail @param {import("./parts.js").CardContext} ctx */
export function roadCard(id, row, detail, ctx) {
  const { f, now } = ctx;
  const road = row ?? {};
  return [
    h("div.lead", {}, row ? flagChip(road.flag) : chip("idle", unknown(id, ctx)),
      road.gate ? chip(road.gate === "open" ? "ok" : "warn", `gate ${road.gate}`) : null),
    facts([
      ["ID", id],
      ["Why", road.why ?? null],
      ["Probability of stable", typeof detail?.p_stable === "number" ? f.share(detail.p_stable, 0) : null],
      ["Gate", road.gate_why ?? null],
      ["Since", road.since ? f.time(road.since, now) : null],
      ["Watched by", road.rsu ? link("rsu", road.rsu) : null],
      ["Speed", row ? h("span", {}, f.speed(road.kmh), detail?.limit_kmh ? `, limit ${f.speed(detail.limit_kmh)}` : "") : detail?.limit_kmh ? `limit ${f.speed(detail.limit_kmh)}` : null],
      ["Length", detail?.length_m ? f.distance(detail.length_m) : null],
      ["Vehicles in view", row ? f.number(road.vehicles) : null],
    ]),
    detail ? [
      detail.features?.length ? section("Features", features(detail.features, f)) : null,
      detail.hour?.t?.length ? section("The last hour", hour(detail.hour, detail.features ?? [], ctx)) : row ? section("The last hour", h("p.muted", {}, "Nothing is stored of it.")) : null,
      section("Vehicles counted", counts(detail.counts, ctx)),
      section("Platoons refused here", detail.refused?.length ? longTable(["#Cycle", "#Time", "Vehicles", "Why"], detail.refused.map((one) => [
        link("cycle", String(one.cycle)), f.time(one.t, now), links("vehicle", one.vehicles), words(one.why),
      ]), "Platoons refused here", 6) : h("p.muted", {}, "None.")),
      detail.stopped?.length ? section("Stopped vehicles", longTable(["#Lane", "#Along the road", "#Since"], detail.stopped.map((one) => [
        f.number(one.lane), f.distance(one.along_m), f.clock(one.since),
      ]), "Stopped vehicles")) : null,
    ] : h("p.muted", {}, "Loading…"),
  ];
}

/** What passed in the last quarter hour, or why that is not known. */
function counts(told, { f, now }) {
  if (!told) return h("p.muted", {}, "Not counted: no roadside unit has told of it.");
  const inUnit = (kmh) => f.number(f.speedValue(kmh), 1);
  const speed = (one) => (one ? `${inUnit(one.value)}${one.standard_error === null ? "" : ` ± ${inUnit(INTERVAL * one.standard_error)}`} ${f.speedUnit}` : null);
  return [
    facts([
      [told.complete ? "Quarter hour" : "Until now", f.window(told.begin, told.end, now)],
      [told.complete ? "Over for" : "Told", told.complete ? f.duration(Math.max(0, now - told.end) / 1000) : `${f.duration(Math.max(0, now - told.end) / 1000)} ago`],
      ["Watched", `${f.share(told.watched_share, 0)}${told.why && told.flows.length ? `, the rest not: ${words(told.why)}` : ""}`],
      ["Mean speed", speed(told.kmh)],
      ["85 % no faster than", speed(told.v85_kmh)],
    ]),
    told.flows.length ? smallTable(["Class", "#Vehicles/h", "#±", "#Counted"], told.flows.map((flow) => [
      flow.kind, f.number(flow.vph), flow.standard_error === null ? "–" : f.number(INTERVAL * flow.standard_error), f.number(flow.vehicles),
    ]), "Vehicles an hour with 95 % intervals") : h("p.muted", {}, `Not counted: ${words(told.why)}.`),
  ];
}

/** Of a road without a row: what is stored then may tell nothing of one that is watched. */
function unknown(id, { tables, t }) {
  const watched = [...(tables.rsus?.values() ?? [])].some((rsu) => rsu.segments?.includes(id));
  return !watched ? "not watched by any roadside unit" : t === null ? "nothing known yet" : "nothing known then";
}

function features(all, f) {
  return longTable(["Feature", "#Value", "#±", "#Threshold", ""], all.map((feature) => [
    h("span", {}, words(feature.name), feature.unit ? h("span.muted", {}, ` ${feature.unit}`) : null),
    f.measure(feature.value),
    feature.standard_error === null || feature.standard_error === undefined ? "–" : f.measure(INTERVAL * feature.standard_error),
    f.measure(feature.threshold),
    feature.crossed ? chip("bad", "crossed") : feature.threshold === null || feature.threshold === undefined ? "" : chip("ok", "kept"),
  ]), "Features with 95 % intervals", 12);
}

function hour(series, all, ctx) {
  const { f, width } = ctx;
  const until = Math.max(ctx.now, series.t.at(-1));
  const from = until - HOUR_MS;
  const scale = { from, until, width, t: series.t, time: (ms) => f.time(ms, ctx.now) };
  const known = SERIES.filter(([key]) => series[key]?.some((value) => value !== null));
  return [
    series.flag ? h("figure", {}, h("figcaption", {}, "Flag"), flagStrip({ ...scale, label: "Flag in the last hour", flags: series.flag })) : null,
    known.map(([key, name]) => {
      const speed = key === "kmh";
      const convert = (values) => (speed ? values?.map((value) => (value === null ? null : f.speedValue(value))) : values);
      const title = speed ? `${name}, ${f.speedUnit}` : name;
      return h("figure", { "data-key": key }, h("figcaption", {}, title), lineChart({
        ...scale, label: `${title} in the last hour`, values: convert(series[key]), low: convert(series[`${key}_low`]), high: convert(series[`${key}_high`]),
        threshold: thresholdOf(key, all), show: (value) => f.measure(value),
      }));
    }),
    h("p.key", {}, h("span.key-interval", {}, "least to most of a minute's states"), h("span.key-threshold", {}, "threshold of the flag")),
  ];
}

/** The threshold of a series; that of the spread is told in the speed's unit. */
function thresholdOf(key, all) {
  const named = (name) => all.find((feature) => feature.name === name);
  if (key === "variance") return named("acceleration variance")?.threshold ?? null;
  const [spread, speed] = [named("speed spread"), named("mean speed")];
  return key === "cv" && spread?.threshold && speed?.value ? spread.threshold / speed.value : null;
}
