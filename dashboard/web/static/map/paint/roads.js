/** Drawing of streets, of watched roads by their flag, and of platoons' ways. */

import { widthOf } from "../plane/network.js";

/** How a flag is drawn: colour by the palette, pattern in widths of its line. @type {Record<string, number[]>} */
export const PATTERNS = { stable: [], turbulent: [3.2, 1.8], unknown: [0.01, 2.4] };

/** Streets of rank 2 shorter than this, in px, are left out far away. */
const MIN_STREET_PX = 1.5;

/**
 * Draw the land and all streets in view.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {import("../plane/network.js").Network} network
 * @param {any} palette
 */
export function drawStreets(context, view, network, palette) {
  context.fillStyle = palette.land;
  context.fillRect(0, 0, view.width, view.height);
  const ranks = [new Path2D(), new Path2D(), new Path2D()];
  for (const number of network.streetsNear(view.bounds(20))) {
    const street = network.streets[number];
    const line = network.detail(street, view.scale);
    if (street.rank === 2 && isShort(line, MIN_STREET_PX / view.scale)) continue;
    trace(ranks[street.rank], view.project(line));
  }
  context.lineJoin = context.lineCap = "round";
  const widths = ranks.map((_, rank) => widthOf(rank, view.scale));
  const isNear = widths[2] >= 3;
  context.strokeStyle = isNear ? palette.streetEdge : palette.streetFar;
  for (const rank of [2, 1, 0]) {
    context.lineWidth = widths[rank] + (isNear ? 2 : 0);
    context.stroke(ranks[rank]);
  }
  if (!isNear) return;
  context.strokeStyle = palette.street;
  for (const rank of [2, 1, 0]) {
    context.lineWidth = widths[rank];
    context.stroke(ranks[rank]);
  }
}

function isShort(line, length) {
  return Math.abs(line.at(-2) - line[0]) + Math.abs(line.at(-1) - line[1]) < length;
}

/** Sizes of the lines beside a street's middle, px. @param {number} scale  px a metre */
export function lanes(scale) {
  const flag = Math.max(2.4, Math.min(6, 2.4 + 6 * scale));
  const right = Math.max(flag / 2 + 0.7, widthOf(2, scale) / 4);
  const band = 1.25 * flag + 1;
  return { flag, right, band, route: flag + 4.5, beside: right + flag / 2 + band / 2 + 1 };
}

/**
 * Draw watched roads by their flag.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {import("../plane/network.js").Network} network
 * @param {any} palette
 * @param {Iterable<[string, any]>} roads  ids and rows
 * @param {number} [wider]  factor of the lines' width
 */
export function drawFlags(context, view, network, palette, roads, wider = 1) {
  const { flag, right } = lanes(view.scale);
  const width = flag * wider;
  const paths = { stable: new Path2D(), turbulent: new Path2D(), unknown: new Path2D() };
  for (const [id, row] of roads) {
    const road = network.index.get(id);
    if (road !== undefined && isSeen(network, road, view)) {
      trace(paths[row.flag] ?? paths.unknown, network.lineOf(road, view, right));
    }
  }
  context.lineJoin = "round";
  for (const [name, path] of Object.entries(paths)) {
    context.lineCap = "butt";
    context.setLineDash([]);
    context.strokeStyle = palette.halo;
    context.lineWidth = width + 1.6;
    context.stroke(path);
    context.strokeStyle = palette[name];
    context.lineWidth = width;
    context.lineCap = name === "unknown" ? "round" : "butt";
    context.setLineDash(PATTERNS[name].map((part) => part * width));
    context.stroke(path);
  }
  context.setLineDash([]);
}

/**
 * Draw the band of roads on which platoons drive, beside the flag.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {import("../plane/network.js").Network} network
 * @param {any} palette
 * @param {Iterable<number>} roads  road indices
 */
export function drawBands(context, view, network, palette, roads) {
  const { band, beside } = lanes(view.scale);
  const path = new Path2D();
  for (const road of roads) {
    if (isSeen(network, road, view)) trace(path, network.lineOf(road, view, beside));
  }
  strokeBand(context, palette, path, band);
}

/** @param {CanvasRenderingContext2D} context @param {any} palette @param {Path2D} path @param {number} width  px */
export function strokeBand(context, palette, path, width) {
  context.lineCap = "butt";
  context.lineJoin = "round";
  context.strokeStyle = palette.platoon;
  context.lineWidth = width;
  context.stroke(path);
  context.strokeStyle = palette.platoonFill;
  context.lineWidth = width - 2.4;
  context.stroke(path);
}

/** Whether a road's street may be in view. */
function isSeen(network, road, view) {
  const line = network.streets[network.streetOf[road]].line;
  const [x0, y0, x1, y1] = view.bounds(30);
  let [west, east, south, north] = [true, true, true, true];
  for (let i = 0; i < line.length; i += 2) {
    if (line[i] >= x0) west = false;
    if (line[i] <= x1) east = false;
    if (line[i + 1] >= y0) south = false;
    if (line[i + 1] <= y1) north = false;
  }
  return !(west || east || south || north);
}

/** Add a line to a path. @param {Path2D} path @param {number[]} line  px */
export function trace(path, line) {
  path.moveTo(line[0], line[1]);
  for (let i = 2; i < line.length; i += 2) path.lineTo(line[i], line[i + 1]);
}
