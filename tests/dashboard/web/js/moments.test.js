/** A moment is taken as it is written, in the page's zone or its own, or refused in words. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Format } from "../../../../dashboard/web/static/format.js";
import { readMoment } from "../../../../dashboard/web/static/moments.js";

const f = new Format({ time_zone: "Europe/Berlin" });
const now = Date.UTC(2026, 10, 26, 19, 0);
const shown = now - 3 * 86_400_000;

/** @param {string} text @returns {any} */
const read = (text) => readMoment(text, f, { now, shown });

test("a moment of now, of yesterday, of the day shown, and of another zone", () => {
  for (const [text, utc] of [
    ["2026-11-25 14:00", "2026-11-25T13:00"],
    ["yesterday 14:00", "2026-11-25T13:00"],
    ["today 8:05", "2026-11-26T07:05"],
    ["14:00", "2026-11-23T13:00"],
    ["2026-11-25T14:00Z", "2026-11-25T14:00"],
    ["2026-11-25 14:00 +05:30", "2026-11-25T08:30"],
  ]) {
    assert.deepEqual([new Date(read(text).t).toISOString().slice(0, 16), read(text).note], [utc, null], text);
  }
});

test("a date that there is not, and an hour that clocks skip, are refused", () => {
  assert.equal(read("2026-02-30 14:00").problem, "There is no 2026-02-30 14:00:00.");
  assert.match(read("2026-03-29 02:30").problem, /clocks were put forward/);
  assert.match(read("at noon").problem, /“at noon” is no moment.*time zone/);
});

test("of an hour that came twice the first is taken, and said", () => {
  const told = read("2026-10-25 02:30");
  assert.equal(new Date(told.t).toISOString().slice(0, 16), "2026-10-25T00:30");
  assert.match(told.note, /came twice/);
});
