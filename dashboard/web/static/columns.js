/** The columns of each table: what they show, what they sort by, and which ones a narrow table leaves to the card. */

import { words } from "./format.js";
import { doing, doubts } from "./judged.js";
import { FLAG_SIGN, levelRank, levelSign, levelWord, severityLevel, swatch } from "./marks.js";

/**
 * @typedef {Object} Column
 * @property {string} key
 * @property {string} label
 * @property {number} width px; the text columns of a table share what is left
 * @property {boolean} [figure] right-aligned
 * @property {boolean} [grow] takes the width that is left
 * @property {number} rank columns of the highest ranks go first where there is no room
 * @property {(row: any, id: string) => string} text
 * @property {(row: any) => string} [whole] what a pointer over it shows
 * @property {(row: any, id: string) => any} [value] what it sorts by, the text if left out
 * @property {(cell: HTMLElement, row: any, id: string) => void} [paint] draws beside the text
 */

/** @param {import("./format.js").Format} f @param {{names: Map<string, string>, now: () => number}} city */
export function makeColumns(f, city) {
  const level = (of = (row) => row.level) => ({
    key: "level", label: "State", short: "", width: 26, rank: 0,
    text: (row) => levelSign(of(row)),
    value: (row) => levelRank(of(row)),
    paint: (cell, row) => {
      cell.dataset.level = of(row);
      cell.setAttribute("aria-label", levelWord(of(row)));
    },
  });
  const id = (label, width = 104) => ({ key: "id", label, width, rank: 0, text: (_row, name) => name });
  const text = (key, label, width, rank, extra = {}) => ({ key, label, width, rank, text: (row) => row[key] ?? "–", ...extra });
  const figure = (key, label, width, rank, show) => ({
    key, label, width, rank, figure: true, text: (row) => show(row[key]), value: (row) => row[key],
  });
  const time = (key, label, rank) => ({
    ...figure(key, label, 58, rank, (ms) => f.brief(ms, city.now())), whole: (row) => f.moment(row[key]),
  });
  const code = (key, label, width, rank, extra = {}) => text(key, label, width, rank, { text: (row) => words(row[key]), ...extra });

  return {
    vehicles: [
      level(),
      { ...id("Vehicle"), paint: paintVehicle },
      text("text", "Now", 120, 1, { grow: true, text: (row) => doing(row, f, city.now()) }),
      text("next", "Next stop", 92, 3),
      time("eta", "ETA", 2),
      figure("delay_s", "Delay", 76, 2, (s) => f.delay(s)),
      figure("stops_left", "Stops", 48, 5, (n) => f.number(n)),
      text("platoon", "Platoon", 88, 4, {
        text: (row) => (row.platoon ? `${row.platoon}${row.place === null ? "" : ` · ${row.place + 1}`}` : "–"),
      }),
      figure("saved_kwh", "To save kWh", 84, 6, (kwh) => f.number(kwh, 3)),
      figure("platoon_km", "In platoon", 76, 7, (km) => f.km(km)),
      text("source", "Place", 76, 8, { text: (row) => ({ reported: "reported", last: "last heard", planned: "by plan" })[row.source] ?? "–" }),
      text("carrier", "Carrier", 90, 9),
    ],
    roads: [
      level(),
      text("name", "Road", 120, 0, { grow: true, text: (_row, road) => city.names.get(road) || road }),
      text("flag", "Flag", 92, 1, {
        text: (row) => `${FLAG_SIGN[row.flag] ?? "?"} ${row.flag ?? "unknown"}`,
        paint: (cell, row) => { cell.dataset.flag = row.flag ?? "unknown"; },
      }),
      { ...figure("kmh", f.speedUnit, 52, 2, (kmh) => (kmh === null ? "–" : f.number(f.speedValue(kmh ?? NaN)))) },
      time("since", "Since", 3),
      code("gate", "Gate", 58, 4),
      figure("vehicles", "Vehicles", 62, 5, (n) => f.number(n)),
      text("why", "Why", 150, 4, { text: (row) => row.why ?? row.gate_why ?? "–" }),
      text("rsu", "RSU", 80, 7),
      figure("cv", "Variation", 68, 8, (cv) => f.number(cv, 2)),
      figure("stopped", "Stopped", 62, 9, (n) => f.number(n)),
      { ...id("ID", 104), rank: 7 },
    ],
    rsus: [
      level(),
      id("RSU", 92),
      text("why", "How it is", 130, 1, { grow: true, text: (row) => row.why || (row.faults ?? []).map(words).join(", ") || words(row.status) }),
      figure("fps", "Frames/s", 66, 2, (n) => f.number(n, 1)),
      figure("latency_ms", "Latency ms", 76, 3, (n) => f.number(n)),
      figure("skipped_share", "Skipped", 62, 4, (x) => f.share(x)),
      figure("vehicles", "Vehicles", 62, 5, (n) => f.number(n)),
      { ...figure("segments", "Roads", 50, 6, (roads) => f.number(roads?.length ?? 0)), value: (row) => row.segments?.length ?? 0 },
      figure("seen", "Last heard", 76, 4, (ms) => (ms === null ? "now" : f.clock(ms))),
      code("status", "Status", 76, 8),
    ],
    orders: [
      level(),
      id("Order", 100),
      code("state", "State", 84, 1),
      text("vehicle", "Vehicle", 92, 2),
      time("eta", "ETA", 3),
      {
        key: "latest", label: "Window", width: 112, rank: 4, figure: true,
        text: (row) => f.briefWindow(row.earliest, row.latest, city.now()), value: (row) => row.latest,
        whole: (row) => f.window(row.earliest, row.latest, city.now()),
      },
      figure("late_s", "Late", 76, 2, (s) => (s > 0 ? f.delay(s) : "–")),
      text("why", "Why", 130, 2, { grow: true, text: (row) => [...doubts(row, f, city.now()), row.why].filter(Boolean).join("; ") || "–" }),
      text("pinned", "Locked", 58, 6, { text: (row) => (row.pinned ? "locked" : "–") }),
      time("since", "Since", 7),
      text("node", "Place", 92, 8),
      text("source", "Source", 76, 9),
    ],
    cycles: [
      level(),
      { key: "id", label: "Cycle", width: 60, rank: 0, figure: true, text: (_row, n) => n, value: (_row, n) => Number(n) },
      figure("t", "Time", 78, 0, (ms) => f.clock(ms)),
      code("status", "Result", 100, 1, { grow: true, text: (row) => (row.why ? `${words(row.status)}: ${row.why}` : words(row.status)) }),
      figure("saved_kwh", "To save kWh", 84, 2, (kwh) => f.number(kwh, 2)),
      figure("saved_share", "To save", 60, 3, (x) => f.share(x)),
      figure("platoon_km", "In platoons", 80, 4, (km) => f.km(km)),
      figure("wall_s", "Took s", 56, 4, (s) => f.number(s, 1)),
      text("solver", "Solver", 86, 5),
      figure("plans", "Plans", 50, 6, (n) => f.number(n)),
      figure("unserved", "Unserved", 68, 3, (n) => f.number(n)),
      figure("variables", "Variables", 70, 8, (n) => f.number(n)),
    ],
    alarms: [
      { ...level((row) => (row.ended ? "idle" : severityLevel(row.severity))), label: "Severity" },
      text("text", "Alarm", 160, 0, { grow: true }),
      text("subject", "Subject", 112, 2),
      time("since", "Since", 1),
      {
        key: "acknowledged", label: "Acknowledged", width: 104, rank: 3,
        text: (row) => (row.acknowledged ? `${f.time(row.acknowledged, city.now())}${row.by ? ` ${row.by}` : ""}` : row.ended ? "–" : "not yet"),
        value: (row) => row.acknowledged ?? 0,
      },
      time("ended", "Ended", 4),
      text("severity", "Severity", 76, 5),
      text("mend", "Mend", 160, 6),
    ],
  };
}

function paintVehicle(cell, row) {
  const look = `${row.colour}${row.source}`;
  if (cell.dataset.look === look) return;
  cell.dataset.look = look;
  cell.querySelector("svg")?.remove();
  cell.prepend(swatch(row.colour, row.source));
}

/** Trouble before names, what is over last; the newest cycle first. Answers a figure that rows are ordered by before their names. */
export const TROUBLE = {
  vehicles: (row) => levelRank(row.level),
  roads: (row) => levelRank(row.level),
  rsus: (row) => levelRank(row.level),
  orders: (row) => (row.state === "served" || row.state === "cancelled" ? 10 : 0) + levelRank(row.level),
  cycles: (row) => -row.t,
  alarms: (row) => (row.ended ? 10 : row.acknowledged ? 5 : 0) + levelRank(severityLevel(row.severity)),
};
