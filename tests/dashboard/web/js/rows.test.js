/** Which rows are shown and in which order; what a search finds; what an address names. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { hashOf, parseSubject } from "../../../../dashboard/web/static/router.js";
import { RowOrder } from "../../../../dashboard/web/static/rows.js";
import { find } from "../../../../dashboard/web/static/search.js";

const COLUMNS = [
  { key: "id", text: (_row, id) => id },
  { key: "state", text: (row) => row.state ?? "–" },
  { key: "kwh", text: (row) => String(row.kwh), value: (row) => row.kwh },
];
const ROWS = () => new Map([
  ["van-10", { state: "waits", kwh: null, level: "ok" }],
  ["van-2", { state: "drives", kwh: 3, level: "bad" }],
  ["van-1", { state: "drives", kwh: 20, level: "ok" }],
]);
const order = () => new RowOrder(COLUMNS, (row) => (row.level === "bad" ? 0 : 1));

test("trouble comes before names, and names are ordered by their numbers", () => {
  const rows = order();
  rows.update(ROWS(), null);
  assert.deepEqual(rows.ids, ["van-2", "van-1", "van-10"]);
});

test("a heading sorts in both directions; what is unknown comes last in either", () => {
  const rows = order();
  for (const [down, wanted] of [[false, ["van-2", "van-1", "van-10"]], [true, ["van-1", "van-2", "van-10"]]]) {
    rows.sort = { key: "kwh", down: Boolean(down) };
    rows.update(ROWS(), null);
    assert.deepEqual(rows.ids, wanted);
  }
});

test("each word has to be somewhere in the row, also after it has changed", () => {
  const rows = order();
  const table = ROWS();
  rows.filter = "van-1 DRIVES";
  rows.update(table, null);
  assert.deepEqual(rows.ids, ["van-1"]);
  table.get("van-10").state = "drives";
  rows.update(table, new Set(["van-10"]));
  assert.deepEqual(rows.ids, ["van-1", "van-10"]);
  rows.filter = "";
  rows.level = "trouble";
  rows.update(table, null);
  assert.deepEqual(rows.ids, ["van-2"]);
});

test("rows keep their places while none comes or goes", () => {
  const rows = order();
  const table = ROWS();
  rows.update(table, null);
  table.get("van-2").level = "ok";
  rows.update(table, new Set(["van-2"]), true);
  assert.deepEqual(rows.ids, ["van-2", "van-1", "van-10"]);
  table.delete("van-1");
  rows.update(table, new Set(["van-1"]), true);
  assert.deepEqual(rows.ids, ["van-2", "van-10"]);
});

test("the same name first, then those that begin with it, then those that hold it", () => {
  const road = (id, name = "") => ({ kind: "road", id, name });
  const found = find("mill", [road("r-1", "Old Mill Road"), road("r-3", "Mill Street"), road("mill"), road("r-2", "Mill Street"), road("x")]);
  assert.deepEqual(found.map(({ id }) => id), ["mill", "r-2", "r-3", "r-1"]);
  assert.deepEqual(find("  ", [road("x")]), []);
});

test("an address names its subject, whatever characters its name has", () => {
  for (const id of ["van-1", "a/b:c", "<img src=x>/ä %41"]) {
    assert.deepEqual(parseSubject(hashOf({ kind: "vehicle", id })), { kind: "vehicle", id });
  }
  assert.deepEqual(parseSubject("rsu/12"), { kind: "rsu", id: "12" });
  for (const none of ["", "#", "#van", "#nothing/x", "#van/%E0%A4%A"]) assert.equal(parseSubject(none), null);
});
