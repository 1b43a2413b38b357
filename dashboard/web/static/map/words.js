/** What the map says in words: tooltips, and the sum of what is shown. */

const MAX_NAMES = 8;

/** How long ago: "40 s", "3 min", "2 h". Silence is of the present only. @param {number} ms */
export function age(ms) {
  const seconds = Math.max(0, Math.round((Date.now() - ms) / 1000));
  if (seconds < 100) return `${seconds} s`;
  return seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${Math.round(seconds / 3600)} h`;
}

/** @param {number} kmh @param {string} units */
function speed(kmh, units) {
  return units === "imperial" ? `${Math.round(kmh / 1.609344)} mph` : `${Math.round(kmh)} km/h`;
}

/**
 * Lines of a tooltip, the title first.
 * @param {import("./hit.js").Hit} hit
 * @param {import("./scene.js").Scene} scene
 * @param {string} units  metric or imperial
 * @returns {string[]}
 */
export function describe(hit, { tables, network }, units) {
  const lines = DESCRIPTIONS[hit.kind](hit, tables, network, units);
  return lines.filter((line) => line);
}

/** @type {Record<string, Function>} */
const DESCRIPTIONS = {
  vehicle({ id }, tables) {
    const row = tables.vehicles.get(id) ?? {};
    const place = { reported: "place as reported", last: `heard here last, ${age(row.seen)} ago` }[row.source] ?? "place by plan";
    const platoon = row.platoon && row.with?.length ? `in a platoon with ${names(row.with)}` : "";
    return [id, row.text ?? row.state, platoon, place];
  },
  cluster({ group }) {
    return [`${group.members.length} vehicles`, names(group.members.map((mover) => mover.id))];
  },
  road({ id }, tables, network, units) {
    const road = network.roads[network.index.get(id)];
    const row = tables.roads.get(id);
    const limit = `limit ${speed(road.limit_kmh, units)}`;
    const title = road.name ?? id;
    const second = road.name ? id : "";
    if (!row) return [title, second, `${limit}, not watched`];
    const traffic = [row.flag, row.kmh == null ? "" : speed(row.kmh, units), limit].filter(Boolean).join(", ");
    const gate = row.gate ? `gate ${row.gate}${row.gate === "closed" && row.gate_why ? `: ${row.gate_why}` : ""}` : "";
    const stopped = row.stopped ? `${row.stopped} stopped` : "";
    return [title, second, traffic, row.why, gate, stopped];
  },
  rsu({ id }, tables) {
    const row = tables.rsus.get(id) ?? {};
    return [id, row.status, row.why, row.fps == null ? "" : `${row.fps.toFixed(1)} pictures/s`];
  },
  order({ id }, tables) {
    const row = tables.orders.get(id) ?? {};
    const late = row.late_s > 0 ? `${Math.ceil(row.late_s / 60)} min late` : "";
    const overdue = row.late_since && !late ? `late for ${age(row.late_since)}` : "";
    const silent = row.silent_since ? `vehicle silent for ${age(row.silent_since)}` : "";
    return [id, [row.state?.replace("_", " "), late, overdue, silent].filter(Boolean).join(", "), row.vehicle && `by ${row.vehicle}`, row.why];
  },
  depot({ id }) {
    return [id, "depot"];
  },
};

function names(ids) {
  const more = ids.length - MAX_NAMES;
  return ids.slice(0, MAX_NAMES).join(", ") + (more > 0 ? ` and ${more} more` : "");
}

/** The whole map in a sentence or two, for those who do not see it. @param {import("./scene.js").Scene} scene */
export function summary({ network, tables, selection }) {
  const count = (number, word) => `${number} ${word}${number === 1 ? "" : "s"}`;
  const vehicles = [...tables.vehicles.values()];
  const placed = vehicles.filter((row) => row.x != null);
  const planned = placed.filter((row) => row.source === "planned").length;
  const silent = placed.filter((row) => row.source === "last").length;
  const flags = { stable: 0, turbulent: 0, unknown: 0 };
  for (const row of tables.roads.values()) flags[row.flag] = (flags[row.flag] ?? 0) + 1;
  const bad = [...tables.rsus.values()].filter((row) => row.level === "bad" || row.level === "warn").length;
  return [
    `Map of ${count(network.roads.length, "road")}.`,
    `${count(placed.length, "vehicle")} shown of ${vehicles.length}, ${planned} by plan${silent ? `, ${silent} silent` : ""}.`,
    `Watched roads: ${flags.stable} stable, ${flags.turbulent} turbulent, ${flags.unknown} unknown.`,
    `${count(tables.rsus.size, "roadside unit")}, ${bad} with trouble.`,
    selection ? `Selected: ${selection.kind} ${selection.id}.` : "",
  ].filter(Boolean).join(" ");
}
