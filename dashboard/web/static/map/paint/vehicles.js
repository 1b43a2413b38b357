/**
 * Drawing of vehicles: dots far away, arrows nearer, discs with a name's end close by.
 * Filled: reported by the vehicle; hollow: where it should be by its plan, or where a silent one was last, which has a mark.
 * @module
 */

import { drawHalo, isOutside, mark, outlined } from "./markers.js";
import { stamp } from "./sprites.js";

/** @typedef {"dot"|"arrow"|"disc"} Style */

/** Radius of a vehicle's sign, px. */
export const VEHICLE_RADIUS = { dot: 4, arrow: 8, disc: 11 };

/** States in which a vehicle has no direction worth showing. */
const STANDING = new Set(["stopped", "waiting", "silent"]);
const RESTING = new Set(["depot", "idle", "expired"]);
const DISCS_FROM = 0.9;
const ARROWS_FROM = 0.12;
/** So few vehicles are arrows at any scale. */
const FEW = 40;

/** @param {number} scale  px a metre @param {number} count  of vehicles @returns {Style} */
export function styleFor(scale, count) {
  if (scale >= DISCS_FROM) return "disc";
  return scale >= ARROWS_FROM || count <= FEW ? "arrow" : "dot";
}

/** Whether a vehicle's place is what it reported itself. */
export function isReported(row) {
  return row.source === "reported";
}

/**
 * Draw vehicles.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {any} palette
 * @param {Iterable<import("../motion.js").Mover>} movers
 * @param {Style} style
 */
export function drawVehicles(context, view, palette, movers, style) {
  const draw = stamp(context, palette);
  /** @type {[import("../motion.js").Mover, number, number][]} */
  const seen = [];
  for (const mover of movers) {
    const [x, y] = [view.px(mover.x), view.py(mover.y)];
    if (isOutside(view, x, y)) continue;
    seen.push([mover, x, y]);
    const { row } = mover;
    const shape = shapeOf(row.state, style);
    const isTurned = shape === "arrow" || shape === "pointedDisc";
    draw(shape, row.colour ?? 0, isReported(row), x, y, isTurned ? mover.heading : 0);
  }
  for (const [{ row }, x, y] of seen) if (row.state === "silent") drawSilence(context, palette, row.level, x + 8, y - 8);
  if (style === "dot") return;
  for (const [{ id, row }, x, y] of seen) {
    if (style === "disc") {
      const ink = isReported(row) ? palette.halo : palette.vehicles[row.colour ?? 0];
      mark(context, tagOf(id), x, y, ink, palette.font, 10);
    }
    if (row.state === "stopped" || row.state === "waiting") drawBadge(context, palette, row.state, x + 8, y - 8);
  }
}

/** @returns {import("./sprites.js").Shape} */
function shapeOf(state, style) {
  const isResting = RESTING.has(state);
  if (style === "dot") return isResting ? "smallDot" : "dot";
  const isStanding = isResting || STANDING.has(state);
  if (style === "disc") return isStanding ? "disc" : "pointedDisc";
  return isResting ? "rest" : isStanding ? "square" : "arrow";
}

/** The end of a name that tells vehicles apart: its last figures, or else letters. */
export function tagOf(id) {
  return (/\d{1,3}$/.exec(id)?.[0] ?? id.slice(-2)).toUpperCase();
}

/** The mark of a vehicle that is not heard any more. */
function drawSilence(context, palette, level, x, y) {
  const path = new Path2D();
  path.arc(x, y, 5.5, 0, 2 * Math.PI);
  outlined(context, path, palette[level] ?? palette.idle, palette.halo);
  mark(context, "?", x, y, palette.halo, palette.font, 9);
}

/** A stopped vehicle's bar, a waiting one's two strokes. */
function drawBadge(context, palette, state, x, y) {
  const path = new Path2D();
  path.arc(x, y, 5.5, 0, 2 * Math.PI);
  outlined(context, path, state === "stopped" ? palette.bad : palette.inkSoft, palette.halo);
  context.fillStyle = palette.halo;
  if (state === "stopped") context.fillRect(x - 3.5, y - 1.2, 7, 2.4);
  else {
    context.fillRect(x - 2.6, y - 2.8, 1.8, 5.6);
    context.fillRect(x + 0.8, y - 2.8, 1.8, 5.6);
  }
}

/**
 * Draw clusters as rings with their vehicles' number.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {any} palette
 * @param {{group: import("../clusters.js").Cluster, x: number, y: number}[]} circles  where they are, px
 */
export function drawClusters(context, view, palette, circles) {
  for (const { group, x, y } of circles) {
    if (isOutside(view, x, y)) continue;
    const path = new Path2D();
    path.arc(x, y, group.radius - 1.5, 0, 2 * Math.PI);
    outlined(context, path, palette.halo, palette.halo);
    const isBad = group.members.some(({ row }) => row.level === "bad");
    context.strokeStyle = isBad ? palette.bad : palette.ink;
    context.lineWidth = 1.6;
    context.stroke(path);
    mark(context, String(group.members.length), x, y, palette.ink, palette.font, countSize(group));
  }
}

/** Size of a cluster's figures, px. */
export function countSize(group) {
  return group.members.length > 99 ? 9 : 10.5;
}

/**
 * Rings around a selected vehicle and its partners.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {any} palette
 * @param {import("../motion.js").Mover} mover
 * @param {Style} style
 * @param {boolean} isPartner
 */
export function drawVehicleHalo(context, view, palette, mover, style, isPartner) {
  const [x, y] = [view.px(mover.x), view.py(mover.y)];
  const radius = VEHICLE_RADIUS[style] + 6;
  if (!isPartner) {
    drawHalo(context, palette, x, y, radius);
    return;
  }
  drawHalo(context, { ...palette, selected: palette.platoon }, x, y, radius - 1);
}
