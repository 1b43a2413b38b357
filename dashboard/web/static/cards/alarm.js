/** An alarm's card: what is wrong, since when, how to mend it, who has acknowledged it. */

import { h } from "../dom.js";
import { chip, severityLevel } from "../marks.js";
import { KINDS, parseSubject } from "../router.js";
import { actionButton, facts, link } from "./parts.js";

/** @param {string} id @param {any} row @param {any} _detail @param {import("./parts.js").CardContext} ctx */
export function alarmCard(id, row, _detail, ctx) {
  const { f } = ctx;
  const about = parseSubject(row.subject ?? "");
  return [
    h("div.lead", {}, chip(row.ended ? "idle" : severityLevel(row.severity), row.ended ? `${row.severity}, ended` : row.severity)),
    h("p.text", {}, row.text),
    row.mend ? h("p.mend", {}, row.mend) : null,
    facts([
      ["Subject", about ? link(about.kind, about.id, `${KINDS[about.kind].noun} ${about.id}`) : row.subject],
      ["Since", f.moment(row.since)],
      ["Lasts", f.duration(((row.ended ?? ctx.now) - row.since) / 1000)],
      ["Ended", row.ended ? f.moment(row.ended) : null],
      ["Acknowledged", row.acknowledged ? `${f.moment(row.acknowledged)}${row.by ? ` by ${row.by}` : ""}` : "not yet"],
    ]),
    // What the page itself tells is no alarm of the dispatcher's.
    ctx.control && !row.acknowledged && !row.ended && !id.startsWith("page/") ? h("div.buttons", {}, actionButton("Acknowledge", { action: "acknowledge", subject: `alarm/${id}` })) : null,
  ];
}
