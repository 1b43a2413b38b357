/** A vehicle's plan over time: driving, platoons, stops and their windows. */

import { s } from "./dom.js";
import { timeTicks } from "./chart.js";

const LEFT = 6;
const HEIGHT = 80;

/**
 * @param {any} plan of a vehicle's card
 * @param {{now: number, width: number, time: (ms: number) => string}} options
 */
export function timeline(plan, { now, width, time }) {
  const ends = [...plan.segments.map((part) => part.exit), ...plan.stops.map((stop) => stop.departure)];
  const from = Math.min(plan.depart ?? Infinity, ...plan.segments.map((part) => part.entry), ...plan.stops.map((stop) => stop.arrival));
  const until = Math.max(from + 60_000, ...ends);
  const x = (ms) => Math.round((LEFT + (Math.max(0, Math.min(1, (ms - from) / (until - from)))) * (width - 2 * LEFT)) * 10) / 10;
  const bar = (name, begin, end, y, height, title) => s(`rect.${name}`, {
    x: x(begin), y, width: Math.max(1, x(end) - x(begin)), height,
  }, s("title", {}, title));
  const inPlatoon = plan.segments.filter((part) => part.platoon).length;
  const label = `Plan from ${time(from)} to ${time(until)}: ${plan.stops.length} stops, ${inPlatoon} of ${plan.segments.length} roads in a platoon`;
  return s("svg.timeline", { viewBox: `0 0 ${width} ${HEIGHT}`, width, height: HEIGHT, role: "img", "aria-label": label },
    s("g.axes", {}, timeTicks(from, until, width / 80).map((ms) => [
      s("path", { d: `M${x(ms)} 4V${HEIGHT - 16}` }),
      s("text", { x: x(ms), y: HEIGHT - 4, "text-anchor": x(ms) > width - 20 ? "end" : x(ms) < 20 ? "start" : "middle" }, time(ms)),
    ])),
    plan.stops.map((stop, i) => windowBar(stop, i, bar, from, until, time)),
    plan.segments.map((part) => bar("drive", part.entry, part.exit, 26, 5, `${part.road}: ${time(part.entry)}–${time(part.exit)}`)),
    plan.segments.filter((part) => part.platoon).map((part) => bar("platoon", part.entry, part.exit, 22, 13, `${part.road}: in platoon ${part.platoon}, place ${(part.place ?? 0) + 1}`)),
    plan.stops.map((stop, i) => [
      bar(stop.is_hub ? "hub" : "stop", stop.arrival, stop.departure, 18, 21, `${stop.id}: ${time(stop.arrival)}–${time(stop.departure)}`),
      s("text.number", { x: Math.min(width - 8, Math.max(8, x((stop.arrival + stop.departure) / 2))), y: 14, "text-anchor": "middle" }, i + 1),
    ]),
    now >= from && now <= until ? s("path.now", { d: `M${x(now)} 2V${HEIGHT - 14}` }) : null);
}

// Windows of neighbours overlap: every other one is drawn lower.
function windowBar(stop, i, bar, from, until, time) {
  const begin = stop.earliest ?? from;
  const end = stop.latest ?? until;
  if ((stop.earliest === null && stop.latest === null) || end < from || begin > until) return null;
  return bar("window", begin, end, 42 + 7 * (i % 2), 5, `Window of ${stop.id}: ${time(begin)}–${time(end)}`);
}
