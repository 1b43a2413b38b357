/** The map's layers, one function each; the same for the screen and for a picture. */

import { drawDepots, drawHalo, drawOrders, drawRsus, drawStops, RADII } from "./markers.js";
import { drawBands, drawFlags, drawStreets, lanes, trace } from "./roads.js";
import { drawRoutes, drawSelectedRoute } from "./routes.js";
import { drawClusters, drawVehicleHalo, drawVehicles } from "./vehicles.js";

const DIMMED = 0.35;
/** How much of the land's colour lies over what is not selected. */
const VEIL = 0.55;

/** @typedef {import("../scene.js").Scene} Scene */
/** @typedef {import("../plane/view.js").View} View */

/** Streets. @param {CanvasRenderingContext2D} context @param {View} view @param {Scene} scene */
export function paintGround(context, view, scene) {
  drawStreets(context, view, scene.network, scene.palette);
}

/**
 * Flags, routes, platoons' ways and signs of what stands still.
 * @param {CanvasRenderingContext2D} context
 * @param {View} view
 * @param {Scene} scene
 */
export function paintState(context, view, scene) {
  const { network, palette, tables, relation, selection } = scene;
  const [chosen, others] = split(tables.roads, relation?.roads);
  if (!relation) {
    drawRoutes(context, view, network, palette, tables, scene.bands);
    drawBands(context, view, network, palette, scene.bands);
    drawFlags(context, view, network, palette, others);
  } else {
    drawBands(context, view, network, palette, scene.bands);
    drawFlags(context, view, network, palette, others);
    veil(context, view, palette);
    if (selection.kind === "road") drawChosenRoad(context, view, scene, selection.id);
    const vehicle = relation.route === null ? null : tables.vehicles.get(relation.route);
    if (vehicle?.route) drawSelectedRoute(context, view, network, palette, vehicle);
    const bands = [...scene.bands].filter((road) => relation.roads.has(network.roads[road].id));
    drawBands(context, view, network, palette, bands);
    drawFlags(context, view, network, palette, chosen, selection.kind === "vehicle" ? 1 : 1.5);
  }
  paintSigns(context, view, scene);
}

function paintSigns(context, view, { network, palette, tables, relation, selection, stops }) {
  drawDepots(context, view, palette, network.depots);
  const numbered = new Set(stops.map(({ id }) => id));
  const [orders, otherOrders] = split(tables.orders, relation?.orders);
  const [rsus, otherRsus] = split(tables.rsus, relation?.rsus);
  context.globalAlpha = relation ? DIMMED : 1;
  drawOrders(context, view, palette, otherOrders);
  drawRsus(context, view, palette, otherRsus);
  context.globalAlpha = 1;
  drawOrders(context, view, palette, orders.filter(([id]) => !numbered.has(id)));
  drawRsus(context, view, palette, rsus);
  const colour = palette.vehicles[tables.vehicles.get(relation?.route)?.colour ?? 0];
  drawStops(context, view, palette, stops, colour);
  const row = selection && (selection.kind === "rsu" || selection.kind === "order")
    ? tables[`${selection.kind}s`].get(selection.id) : null;
  if (row?.x != null) drawHalo(context, palette, view.px(row.x), view.py(row.y), RADII[selection.kind] + 6);
}

function drawChosenRoad(context, view, { network, palette }, id) {
  const road = network.index.get(id);
  if (road === undefined) return;
  const { flag, right } = lanes(view.scale);
  const path = new Path2D();
  trace(path, network.lineOf(road, view, right));
  context.lineCap = context.lineJoin = "round";
  for (const [colour, wider] of [[palette.selected, 9], [palette.halo, 5.5]]) {
    context.strokeStyle = colour;
    context.lineWidth = 1.5 * flag + wider;
    context.stroke(path);
  }
}

function veil(context, view, palette) {
  context.globalAlpha = VEIL;
  context.fillStyle = palette.land;
  context.fillRect(0, 0, view.width, view.height);
  context.globalAlpha = 1;
}

/** Vehicles where they are now. @param {CanvasRenderingContext2D} context @param {View} view @param {Scene} scene */
export function paintVehicles(context, view, scene) {
  const { palette, relation, selection, singles, style, motion } = scene;
  context.globalAlpha = relation ? DIMMED : 1;
  const [chosen, others] = split(singles.map((mover) => [mover.id, mover]), relation?.vehicles);
  drawVehicles(context, view, palette, others.map(([, mover]) => mover), style);
  drawClusters(context, view, palette, scene.circles(view));
  context.globalAlpha = 1;
  const near = style === "dot" ? "arrow" : style;
  const selected = selection?.kind === "vehicle" ? selection.id : null;
  if (selected !== null) {
    for (const [id, mover] of chosen) {
      if (id !== selected) drawVehicleHalo(context, view, palette, mover, near, true);
    }
    const mover = motion.movers.get(selected);
    if (mover) drawVehicleHalo(context, view, palette, mover, near, false);
  }
  drawVehicles(context, view, palette, chosen.map(([, mover]) => mover), near);
}

/** Entries whose keys are in a set, and all others. */
function split(entries, set) {
  const found = [[], []];
  for (const entry of entries) found[set?.has(entry[0]) ? 0 : 1].push(entry);
  return found;
}
