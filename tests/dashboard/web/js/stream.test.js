/** The stream is read however it is cut, and its deltas are taken into the tables. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Store } from "../../../../dashboard/web/static/store.js";
import { eventParser } from "../../../../dashboard/web/static/stream.js";

test("events arrive whole; comments and events without data are dropped", () => {
  const found = [];
  const parse = eventParser((event, data) => found.push([event, data]));
  for (const piece of [
    ": hello\n\nevent: mo", "ment\ndata: {\"a\":", "1}\n",
    "\ndata: one\ndata: two\r\n\r\n", "event: lost\n\n",
  ]) parse(piece);
  assert.deepEqual(found, [["moment", "{\"a\":1}"], ["message", "one\ntwo"]]);
});

test("a delta changes, adds and removes rows, and says which", () => {
  const store = new Store();
  assert.equal(store.setMoment({ t: 1, live: true, vehicles: { a: { x: 1, y: 2 }, b: { x: 3 } } }), null);
  const changed = store.apply({ t: 2, set: { vehicles: { a: { x: 5 }, c: { x: 6 } } }, del: { vehicles: ["b", "nobody"] }, paused: true });
  assert.deepEqual(Object.fromEntries(store.tables.vehicles), { a: { x: 5, y: 2 }, c: { x: 6 } });
  assert.deepEqual([...changed.vehicles].sort(), ["a", "b", "c"]);
  assert.equal(changed.roads.size, 0);
  assert.deepEqual([store.t, store.live, store.paused], [2, true, true]);
});
