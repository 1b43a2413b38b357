/** Drawing of vehicles' routes and their stops; which roads carry platoons. */

import { lanes, trace } from "./roads.js";

/** With more routes than this none is drawn but the selected vehicle's. */
const MAX_ROUTES = 12;
/** Of routes over one road so many lie beside each other; the others lie on the last of them. */
const MAX_SIDE_BY_SIDE = 5;
const SIDE_BY_SIDE_PX = 2.6;

/**
 * Roads ahead of some vehicle on which it drives in a platoon and whose gate is open.
 * @param {any} tables
 * @param {import("../plane/network.js").Network} network
 * @returns {Set<number>} road indices
 */
export function platoonRoads(tables, network) {
  const found = new Set();
  for (const { route, at } of tables.vehicles.values()) {
    if (!route) continue;
    for (let i = at ?? 0; i < route.length; i++) {
      const [road, inPlatoon] = route[i];
      if (inPlatoon && !found.has(road) && isOpen(tables, network, road)) found.add(road);
    }
  }
  return found;
}

/** A gate that closed takes the band off before the vehicle's own row says so. */
function isOpen(tables, network, road) {
  const id = network.roads[road]?.id;
  return id !== undefined && tables.roads.get(id)?.gate !== "closed";
}

/** Rows of the vehicles whose routes are drawn while none is selected. @param {any} tables @returns {any[]} */
export function routedVehicles(tables) {
  const routed = [...tables.vehicles.values()].filter((row) => row.route?.length);
  return routed.length > MAX_ROUTES ? [] : routed;
}

/**
 * How far roads' lines reach to the right of their streets' middles: flags, platoons' bands, routes.
 * @param {number} scale  px a metre
 * @param {import("../plane/network.js").Network} network
 * @param {any} tables
 * @param {Set<number>} bands  roads with a band
 * @param {import("../relation.js").Relation|null} relation  of the selection, whose route alone is drawn
 * @returns {Map<number, number>} px by road index
 */
export function reaches(scale, network, tables, bands, relation) {
  const { right, flag, beside, band, route } = lanes(scale);
  const found = new Map();
  for (const id of tables.roads.keys()) if (network.index.has(id)) found.set(network.index.get(id), right + flag / 2);
  for (const road of bands) found.set(road, beside + band / 2);
  const drawn = relation ? [tables.vehicles.get(relation.route)].filter((row) => row?.route) : routedVehicles(tables);
  const used = new Map();
  for (const { route: roads, at } of drawn) {
    for (const road of new Set(roads.slice(at ?? 0).map(([index]) => index))) used.set(road, (used.get(road) ?? 0) + 1);
  }
  for (const [road, count] of used) {
    const lines = found.get(road) ?? right - 2;
    const alone = relation ? right + route / 2 : 0;
    found.set(road, Math.max(alone, lines + 3 + SIDE_BY_SIDE_PX * (Math.min(count, MAX_SIDE_BY_SIDE) - 1)));
  }
  return found;
}

/**
 * Draw what lies ahead of each vehicle, if they are few: thin lines side by side.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {import("../plane/network.js").Network} network
 * @param {any} palette
 * @param {any} tables
 * @param {Set<number>} bands  roads with a band, which the lines keep clear of
 */
export function drawRoutes(context, view, network, palette, tables, bands) {
  const { right, flag, beside, band } = lanes(view.scale);
  const clear = (/** @type {number} */ road) => {
    if (bands.has(road)) return beside + band / 2 + 2;
    return tables.roads.has(network.roads[road].id) ? right + flag / 2 + 2 : right;
  };
  const used = new Map();
  context.lineJoin = context.lineCap = "round";
  context.lineWidth = 2;
  for (const row of routedVehicles(tables)) {
    const path = new Path2D();
    const ahead = new Set(row.route.slice(row.at ?? 0).map(([road]) => road));
    for (const road of ahead) {
      if (!network.roads[road]) continue;
      const lane = Math.min(used.get(road) ?? 0, MAX_SIDE_BY_SIDE - 1);
      used.set(road, lane + 1);
      trace(path, network.lineOf(road, view, clear(road) + SIDE_BY_SIDE_PX * lane));
    }
    context.strokeStyle = palette.vehicles[row.colour ?? 0];
    context.stroke(path);
  }
}

/**
 * Draw one vehicle's route as a broad line under the flags; its past part is faint.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {import("../plane/network.js").Network} network
 * @param {any} palette
 * @param {any} row  the vehicle's
 */
export function drawSelectedRoute(context, view, network, palette, row) {
  const { right, route } = lanes(view.scale);
  const at = row.at ?? 0;
  const parts = { past: new Path2D(), ahead: new Path2D() };
  const driven = new Set(row.route.slice(at).map(([road]) => road));
  row.route.forEach(([road], index) => {
    if (!network.roads[road] || (index < at && driven.has(road))) return;
    trace(index < at ? parts.past : parts.ahead, network.lineOf(road, view, right));
  });
  context.lineJoin = context.lineCap = "round";
  context.strokeStyle = palette.vehicles[row.colour ?? 0];
  context.globalAlpha = 0.3;
  context.lineWidth = route - 3;
  context.stroke(parts.past);
  context.globalAlpha = 1;
  context.strokeStyle = palette.halo;
  context.lineWidth = route + 2.5;
  context.stroke(parts.ahead);
  context.strokeStyle = palette.vehicles[row.colour ?? 0];
  context.lineWidth = route;
  context.stroke(parts.ahead);
}
