/** The city at a glance: counts above the tables, each of which opens what it counts. */

import { h, morph } from "./dom.js";

/**
 * Counts of one moment.
 * @param {import("./store.js").Store} store
 * @param {import("./format.js").Format} f
 * @returns {{tab: string, name: string, value: string, notes: string[][]}[]} a note is its level, its text and the filter it opens
 */
export function counts(store, f) {
  const { vehicles, roads, rsus, orders, alarms } = store.tables;
  const n = (table, test) => {
    let found = 0;
    for (const row of table.values()) if (test(row)) found += 1;
    return found;
  };
  const bad = (table) => n(table, (row) => row.level === "bad" || row.level === "warn");
  const number = (value) => f.number(value);
  const trouble = (table) => {
    const found = bad(table);
    return found ? [["warn", `${number(found)} in trouble`, "trouble"]] : [];
  };
  /** A note that is left out where there is nothing to count; it opens what it counts. */
  const some = (found, level, what) => (found ? [[level, `${number(found)} ${what}`, what]] : []);
  const health = (table) => {
    const idle = n(table, (row) => row.level === "idle");
    return !table.size ? "none known" : idle ? `${number(idle)} not known` : "all well";
  };
  const inForce = n(alarms, (row) => !row.ended);
  const waiting = n(alarms, (row) => !row.ended && !row.acknowledged);
  const today = store.energy?.today;
  return [
    {
      tab: "vehicles", name: "Vehicles", value: number(vehicles.size),
      notes: [
        ["", `${number(n(vehicles, (row) => row.state === "driving"))} driving`, ""],
        ["", `${number(n(vehicles, (row) => row.source === "reported" && row.platoon !== null && row.platoon !== undefined && row.with?.length > 0))} in platoons`, ""],
        ...some(n(vehicles, (row) => row.state === "silent" && row.level !== "idle"), "bad", "silent"),
        ...some(n(vehicles, (row) => row.state === "planned"), store.live ? "idle" : "", "by plan"),
        ...trouble(vehicles),
      ],
    },
    {
      tab: "roads", name: "Watched roads", value: number(roads.size),
      notes: ["stable", "turbulent", "unknown"].map((flag) => ({ flag, found: n(roads, (row) => row.flag === flag) }))
        .map(({ flag, found }) => [flag === "turbulent" && found ? "flag" : "", `${number(found)} ${flag}`, found ? flag : ""]),
    },
    { tab: "rsus", name: "RSUs", value: number(rsus.size), notes: bad(rsus) ? trouble(rsus) : [["", health(rsus), ""]] },
    {
      tab: "orders", name: "Open orders", value: number(n(orders, (row) => ["open", "planned", "under_way"].includes(row.state))),
      notes: [
        ["", `${number(n(orders, (row) => row.state === "served"))} served`, "served"],
        ...some(n(orders, (row) => row.silent_since !== null && row.silent_since !== undefined), "bad", "vehicle silent"),
        ...some(n(orders, (row) => row.late_s > 0 || (row.late_since !== null && row.late_since !== undefined)), "warn", "late"),
      ],
    },
    { tab: "alarms", name: "Alarms", value: number(inForce), notes: [[waiting ? "warn" : "", inForce ? `${number(waiting)} not acknowledged` : "none in force", waiting ? "not yet" : ""]] },
    {
      tab: "energy", name: "Saved today", value: today ? f.kwh(today.saved_kwh) : "–",
      notes: today ? [["", f.share(today.saved_share), ""], ["", `${f.km(today.platoon_km)} in platoons`, ""]] : [["", "no plan driven yet", ""]],
    },
  ];
}

/** Draws them. @param {HTMLElement} root @param {ReturnType<typeof counts>} all */
export function drawGlance(root, all) {
  morph(root, h("div", {}, h("ul", {}, all.map(({ tab, name, value, notes }) => h("li", {},
    h("button", { type: "button", "data-tab": tab, "data-filter": "" }, h("span.name", {}, name), h("span.value.num", {}, value)),
    h("span.notes", {}, notes.map(([level, text, filter]) => (filter
      ? h("button.note", { type: "button", "data-tab": tab, "data-filter": filter, "data-level": level || null }, text)
      : h("span.note", { "data-level": level || null }, text)))))))));
}
