/** Figures have units, and times a zone, around the end of summer time too. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { count, Format, words } from "../../../../dashboard/web/static/format.js";

const metric = new Format({ units: "metric", time_zone: "America/New_York", currency: "EUR" });
const imperial = new Format({ units: "imperial", time_zone: "UTC", currency: "USD" });
const utc = new Format({ time_zone: "UTC" });
const summer = Date.UTC(2026, 9, 31, 23, 5, 7);
const winter = Date.UTC(2026, 10, 1, 12, 0, 0);
const SIX_H = 6 * 3_600_000;

/** @param {[string, string][]} pairs what is told, and what should be */
function told(pairs) {
  for (const [text, wanted] of pairs) assert.equal(text.replaceAll("\u00a0", " "), wanted);
}

test("a time has its zone, and its day from half a day on", () => told([
  [metric.clock(summer), "19:05:07"],
  [metric.moment(summer), "Sat 31 Oct 2026, 19:05:07"],
  [metric.zone(summer), "GMT-4"],
  [metric.zone(winter), "GMT-5"],
  [metric.time(summer, winter - SIX_H), "19:05"],
  [metric.time(summer, winter), "31 Oct, 19:05"],
  [metric.brief(summer, winter), "31 Oct"],
  [metric.window(summer, winter, winter), "31 Oct, 19:05–07:00"],
  [metric.briefWindow(summer, winter, winter), "31 Oct–07:00"],
]));

test("a figure has the reader's unit, and what is not known a dash", () => told([
  [metric.speed(50), "50 km/h"],
  [imperial.speed(50), "31 mph"],
  [imperial.distance(100), "328 ft"],
  [metric.distance(1234), "1.2 km"],
  [metric.duration(3725), "1 h 2 min"],
  [metric.duration(-61), "−1 min 1 s"],
  [metric.delay(240), "+4 min"],
  [metric.delay(-20), "on time"],
  [metric.kwh(-0.126, true), "−0.13 kWh"],
  [metric.kwh(12345), "12,345 kWh"],
  [metric.share(0.0642), "6.4 %"],
  [metric.money(-3.5), "−EUR 3.50"],
  [metric.number(null), "–"],
  [metric.number(-0.001, 2), "0.00"],
  [imperial.mass(2500), "2.50 t"],
  [count(1000, "road"), "1,000 roads"],
  [words("under_way"), "under way"],
]));

test("a moment that was written is read back", () => {
  assert.equal(metric.fromLocalInput(metric.localInput(summer)), summer);
  assert.equal(metric.fromLocalInput("2026-11-01T07:00:00"), winter);
  assert.equal(metric.fromLocalInput("eight"), null);
});

test("a clock time is rounded, not cut: a hair short of 21:00 is 21:00, with its day", () => {
  const nine = Date.UTC(2026, 10, 26, 21, 0);
  const midnight = Date.UTC(2026, 10, 27);
  told([
    [utc.window(nine - 0.4, nine + 3_600_000 - 30.001, nine), "21:00–22:00"],
    [utc.window(null, nine - 1, nine), "by 21:00"],
    [utc.clock(nine - 0.0001), "21:00:00"],
    [utc.moment(midnight - 0.3), "Fri 27 Nov 2026, 00:00:00"],
    [utc.localInput(midnight - 0.3), "2026-11-27 00:00:00"],
    [utc.time(midnight - 1, midnight - 864e5), "27 Nov, 00:00"],
  ]);
});
