/** Saves the rows of a table as they are shown: filtered and sorted. */

import { Problem } from "./api.js";
import { h } from "./dom.js";

/** Has the server write the rows, in their order, and saves the file. @param {string} url of the whole table's CSV @param {string[]} ids */
export async function saveRows(url, ids) {
  const answer = await fetch(url, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ ids }) });
  if (!answer.ok) throw new Problem(answer.status, await answer.json().catch(() => ({})));
  const name = /filename="([^"]+)"/.exec(answer.headers.get("Content-Disposition") ?? "")?.[1] ?? "table.csv";
  const href = URL.createObjectURL(await answer.blob());
  h("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 10_000);
}
