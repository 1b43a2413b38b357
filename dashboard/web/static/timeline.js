/** A vehicle's plan over time: driving, platoons, stops, and the window of each stop. */

import { s } from "./dom.js";
import { timeTicks } from "./chart.js";

const EDGE = 6;
/** From the top: numbers of stops, the drive, the first window. */
const NUMBERS_Y = 14;
const DRIVE_Y = 28;
const WINDOWS_Y = 50;
const ROW_PX = 12;
const CLOCK_PX = 18;
const DIGIT_PX = 6.2;
/** With more windows the others are left to the table. */
const MAX_ROWS = 12;
/** Numbers nearer to each other than this are written as one range. */
const APART_PX = 12;

/** @param {any} plan of a vehicle's card @param {{now: number, width: number, time: (ms: number) => string}} options */
export function timeline(plan, { now, width, time }) {
  const ends = [...plan.segments.map((part) => part.exit), ...plan.stops.map((stop) => stop.departure)];
  const from = Math.min(plan.depart ?? Infinity, ...plan.segments.map((part) => part.entry), ...plan.stops.map((stop) => stop.arrival));
  const until = Math.max(from + 60_000, ...ends);
  const all = windows(plan.stops);
  const rows = all.slice(0, all.length > MAX_ROWS ? MAX_ROWS - 1 : MAX_ROWS);
  const left = EDGE + (rows.length ? Math.max(...rows.map(({ whose }) => whose.length)) * DIGIT_PX + 4 : 0);
  const below = WINDOWS_Y + ROW_PX * (rows.length + Number(all.length > rows.length));
  const height = below + CLOCK_PX;
  const x = (ms) => Math.round((left + (Math.max(0, Math.min(1, (ms - from) / (until - from)))) * (width - left - EDGE)) * 10) / 10;
  const bar = (name, begin, end, y, tall, title) => s(`rect.${name}`, {
    x: x(begin), y, width: Math.max(1, x(end) - x(begin)), height: tall,
  }, s("title", {}, title));
  const inPlatoon = plan.segments.filter((part) => part.platoon).length;
  const label = `Plan from ${time(from)} to ${time(until)}: ${plan.stops.length} stops, ${inPlatoon} of ${plan.segments.length} roads in a platoon`;
  return s("svg.timeline", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img", "aria-label": label },
    s("g.axes", {}, timeTicks(from, until, width / 80).map((ms) => [
      s("path", { d: `M${x(ms)} 4V${below}` }),
      s("text", { x: x(ms), y: height - 4, "text-anchor": x(ms) > width - 20 ? "end" : x(ms) < left + 14 ? "start" : "middle" }, time(ms)),
    ])),
    rows.map((row, i) => windowRow(row, WINDOWS_Y + ROW_PX * i, { bar, x, left, from, until, time })),
    all.length > rows.length ? s("text.number", { x: left, y: below - 3 }, `and ${all.length - rows.length} more windows, in the table`) : null,
    plan.segments.map((part) => bar("drive", part.entry, part.exit, DRIVE_Y, 5, `${part.road}: ${time(part.entry)}–${time(part.exit)}`)),
    plan.segments.filter((part) => part.platoon).map((part) => bar("platoon", part.entry, part.exit, DRIVE_Y - 4, 13, `${part.road}: in platoon ${part.platoon}, place ${(part.place ?? 0) + 1}`)),
    plan.stops.map((stop) => bar(stop.is_hub ? "hub" : "stop", stop.arrival, stop.departure, DRIVE_Y - 8, 21, `${stop.id}: ${time(stop.arrival)}–${time(stop.departure)}`)),
    numbers(plan.stops, x, width, left),
    now >= from && now <= until ? s("path.now", { d: `M${x(now)} 2V${below}` }) : null);
}

/** Stops by their window: those that share one have one bar. The first stop's comes first. */
function windows(stops) {
  const found = new Map();
  stops.forEach((stop, i) => {
    const { earliest = null, latest = null } = stop;
    if (earliest === null && latest === null) return;
    const key = `${earliest} ${latest}`;
    if (!found.has(key)) found.set(key, { earliest, latest, stops: [], numbers: [] });
    found.get(key).stops.push(stop);
    found.get(key).numbers.push(i + 1);
  });
  return [...found.values()].map((row) => ({ ...row, whose: ranges(row.numbers) }));
}

/** "2, 4–6" @param {number[]} numbers rising */
export function ranges(numbers) {
  const runs = [];
  for (const number of numbers) {
    const last = runs.at(-1);
    if (last && number === last[1] + 1) last[1] = number;
    else runs.push([number, number]);
  }
  return runs.map(([begin, end]) => (begin === end ? String(begin) : `${begin}–${end}`)).join(", ");
}

/** A window, whose it is, and the visits that it is for. One that lies before or after the plan ends at its edge. */
function windowRow(row, y, { bar, x, left, from, until, time }) {
  const [begin, end] = [row.earliest ?? from, row.latest ?? until];
  const text = row.earliest === null ? `by ${time(end)}` : row.latest === null ? `from ${time(begin)}` : `${time(begin)}–${time(end)}`;
  const title = `Window of ${row.stops.map((stop) => stop.id).join(", ")}: ${text}`;
  return [
    s("text.whose", { x: left - 4, y: y + 8, "text-anchor": "end" }, row.whose),
    bar("window", Math.min(begin, until), Math.max(end, from), y + 2, 5, title),
    row.stops.map((stop) => s("rect.visit", { x: x(stop.arrival), y, width: 2, height: 9 })),
  ];
}

/** Numbers over the stops. */
function numbers(stops, x, width, left) {
  const groups = [];
  stops.forEach((stop, i) => {
    const at = x((stop.arrival + stop.departure) / 2);
    const last = groups.at(-1);
    if (last && at - last.at < APART_PX * (last.numbers.length > 1 ? 2 : 1)) last.numbers.push(i + 1);
    else groups.push({ at, numbers: [i + 1] });
  });
  return groups.map((group) => s("text.number", {
    x: Math.min(width - 8, Math.max(left + 2, group.at)), y: NUMBERS_Y, "text-anchor": "middle",
  }, ranges(group.numbers)));
}
