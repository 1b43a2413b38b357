/** Axes tell their ticks apart, and a lone point is seen. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { lineChart, tickTexts, ticks } from "../../../../dashboard/web/static/chart.js";
import { ranges } from "../../../../dashboard/web/static/timeline.js";

/** As much of an element as charts use. */
class Element {
  constructor(name) {
    this.name = name;
    this.attributes = new Map();
    this.children = [];
  }

  setAttribute(key, value) { this.attributes.set(key, value); }

  append(child) { this.children.push(child); }

  all(wanted) {
    return this.children.flatMap((child) => (child instanceof Element
      ? [...(child.attributes.get("class") === wanted ? [child] : []), ...child.all(wanted)] : []));
  }
}
Object.assign(globalThis, { Node: Element, document: { createElementNS: (_space, name) => new Element(name) } });

test("ticks have as many digits as tell neighbours apart", () => {
  for (const [low, high, texts] of /** @type {[number, number, string[]][]} */ ([
    [0, 0.0011, ["0", "0.0005", "0.0010"]],
    [-2, 4, ["−2", "0", "2", "4"]],
    [0, 1200, ["0", "500", "1,000"]],
    [0, 0.75, ["0", "0.5"]],
  ])) assert.deepEqual(tickTexts(ticks(low, high)), texts);
});

test("a point between gaps is a dot with its interval", () => {
  const chart = /** @type {any} */ (lineChart({
    label: "one", t: [0, 60000, 120000], values: [null, 3, null], low: [null, 2, null],
    high: [null, 4, null], from: 0, until: 120000, width: 300, show: String, time: String,
  }));
  assert.equal(chart.all("point").length, 1);
  assert.match(chart.all("interval")[0].attributes.get("d"), /[HV]/i);
});

test("numbers of stops are told as ranges", () => assert.equal(ranges([1, 3, 4, 5, 9]), "1, 3–5, 9"));
