/** What lies under a pixel. */

import { RADII, showsOrder } from "./paint/markers.js";
import { VEHICLE_RADIUS } from "./paint/vehicles.js";

/** A watched road counts as so many px nearer than another one. */
const WATCHED_PX = 4;

/**
 * @typedef {object} Hit
 * @property {"vehicle"|"road"|"rsu"|"order"|"cluster"|"depot"} kind
 * @property {string} id
 * @property {import("./clusters.js").Cluster} [group]
 */

/**
 * The nearest thing within a distance; vehicles before signs, signs before roads.
 * @param {import("./plane/view.js").View} view
 * @param {import("./scene.js").Scene} scene
 * @param {number} x  px
 * @param {number} y
 * @param {number} within  px from its sign's edge
 * @param {string|null} [without]  a vehicle that is not looked for
 * @returns {Hit|null}
 */
export function pick(view, scene, x, y, within, without = null) {
  const { tables, network } = scene;
  /** @type {{hit: Hit, away: number}|null} */
  let best = null;
  const offer = (/** @type {Hit} */ hit, px, py, radius) => {
    const away = Math.hypot(px - x, py - y) - radius;
    if (away <= within && (!best || away < best.away)) best = { hit, away };
  };
  const radius = VEHICLE_RADIUS[scene.style];
  for (const mover of scene.singles) {
    if (mover.id !== without) offer({ kind: "vehicle", id: mover.id }, view.px(mover.x), view.py(mover.y), radius);
  }
  for (const circle of scene.circles(view)) {
    offer({ kind: "cluster", id: circle.group.members[0].id, group: circle.group }, circle.x, circle.y, circle.radius);
  }
  // A vehicle that is near but not under the pixel leaves a sign that is there its click.
  if (best && best.away <= 0) return best.hit;
  for (const [id, row] of tables.rsus) {
    if (row.x != null) offer({ kind: "rsu", id }, view.px(row.x), view.py(row.y), RADII.rsu);
  }
  for (const [id, row] of tables.orders) {
    const isShown = showsOrder(row, view.scale) || (row.x != null && scene.relation?.orders.has(id));
    if (isShown) offer({ kind: "order", id }, view.px(row.x), view.py(row.y), RADII.order);
  }
  for (const depot of network.depots) {
    offer({ kind: "depot", id: depot.id }, view.px(depot.x), view.py(depot.y), RADII.depot);
  }
  if (best) return best.hit;
  const bonus = (/** @type {number} */ road) => (tables.roads.has(network.roads[road].id) ? WATCHED_PX : 0);
  const found = network.nearest(view, x, y, within, bonus);
  return found && { kind: "road", id: network.roads[found.road].id };
}
