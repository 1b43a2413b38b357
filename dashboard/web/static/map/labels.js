/** Which names are written where: no two on each other, the more important first. */

import { lengthOf, pointAlong } from "./plane/geometry.js";
import { isOutside, RADII, showsOrder } from "./paint/markers.js";
import { widthOf } from "./plane/network.js";
import { boxesAlong, Placement } from "./plane/placement.js";
import { reaches } from "./paint/routes.js";
import { makeLabel } from "./paint/text.js";
import { VEHICLE_RADIUS } from "./paint/vehicles.js";
import { age } from "./words.js";

/** From these scales on, px a metre, all RSUs and orders have names. */
const RSUS_FROM = 0.25;
const ORDERS_FROM = 2.5;
/** So few RSUs in view have names at any scale. */
const FEW_RSUS = 12;
const MAX_VEHICLES = 150;
/** A name is repeated along a street after so many px. */
const REPEAT_PX = 420;
/** One name of a street for so many square px at most. */
const STREET_NAME_PX2 = 30000;
/** Far away a street is named from this length on, in lengths of its name; else near. */
const PROMINENT = [2, 1.1];
const NEAR = 0.3;
/** Names of signs lie so much farther away at most to keep clear of roads' lines, px. */
const MAX_ASIDE_PX = 36;
const ASIDE_STEP_PX = 6;
/** A name is written where its street bends no more than this, px. */
const BEND_PX = 3;

/**
 * Names that stand still: of depots, RSUs, orders and streets.
 * @param {import("./plane/view.js").View} view
 * @param {import("./scene.js").Scene} scene
 * @param {number} margin  px on each side that are drawn but not seen
 * @returns {{labels: import("./paint/text.js").Label[], taken: import("./plane/placement.js").Box[]}} taken: all
 *   boxes that further labels must keep clear of, signs too
 */
export function placeStill(view, scene, margin) {
  const { network, tables, palette, relation, selection } = scene;
  const frame = /** @type {[number, number, number, number]} */ ([margin, margin, view.width - margin, view.height - margin]);
  const placement = new Placement(frame);
  for (const box of scene.covered) placement.block({ ...box, x: box.x + margin, y: box.y + margin });
  const reach = reaches(view.scale, network, tables, scene.bands, relation);
  const lines = linesOf(view, network, reach, frame);
  const labels = [];
  const taken = [];
  const block = (x, y, radius) => {
    const box = { x, y, width: 2 * radius, height: 2 * radius, angle: 0 };
    placement.block(box);
    taken.push(box);
  };
  /** @type {[any, number, number, number, number][]} order, label, x, y, radius */
  const wanted = [];
  const isFew = scene.style !== "dot" && scene.singles.length <= MAX_VEHICLES;
  if (isFew) for (const mover of scene.singles) placement.block(roomFor(mover, view, scene, ""));
  const chosen = selection?.kind === "vehicle" ? scene.motion.movers.get(selection.id) : null;
  if (chosen) placement.block(roomFor(chosen, view, scene, chosen.id));
  const want = (importance, label, x, y, radius) => wanted.push([importance, label, x, y, radius]);
  for (const depot of network.depots) {
    const [x, y] = [view.px(depot.x), view.py(depot.y)];
    if (isOutside(view, x, y)) continue;
    block(x, y, RADII.depot);
    want(1, makeLabel("depot", depot.id, depot.id, palette, { weight: 700 }), x, y, RADII.depot);
  }
  const rsus = [...tables.rsus].filter(
    ([, row]) => row.x != null && !isOutside(view, view.px(row.x), view.py(row.y)),
  );
  const namesAll = view.scale >= RSUS_FROM || rsus.length <= FEW_RSUS;
  for (const [id, row] of rsus) {
    const [x, y] = [view.px(row.x), view.py(row.y)];
    block(x, y, RADII.rsu);
    const isBad = row.level === "bad" || row.level === "warn";
    if (!namesAll && !isBad && !relation?.rsus.has(id)) continue;
    const colour = isBad ? palette[row.level] : palette.inkSoft;
    const isSelected = selection?.kind === "rsu" && selection.id === id;
    want(isSelected ? 0 : isBad ? 2 : 3, makeLabel("rsu", id, id, palette, { colour, size: 10.5 }), x, y, RADII.rsu);
  }
  for (const { row } of scene.stops) block(view.px(row.x), view.py(row.y), RADII.stop);
  for (const [id, row] of tables.orders) {
    const isChosen = relation?.orders.has(id);
    if (row.x == null || !(isChosen || showsOrder(row, view.scale))) continue;
    const [x, y] = [view.px(row.x), view.py(row.y)];
    if (isOutside(view, x, y)) continue;
    block(x, y, RADII.order);
    if (!isChosen && view.scale < ORDERS_FROM) continue;
    const isSelected = selection?.kind === "order" && selection.id === id;
    const radius = isChosen ? RADII.stop : RADII.order;
    want(isSelected ? 0 : 4, makeLabel("order", id, id, palette, { size: 10.5, colour: palette.inkSoft }), x, y, radius);
  }
  // Clusters move: they are no part of `taken`, which is kept for longer.
  for (const { x, y, radius } of scene.circles(view)) {
    placement.block({ x, y, width: 2 * radius, height: 2 * radius, angle: 0 });
  }
  wanted.sort((a, b) => a[0] - b[0]);
  for (const [, label, x, y, radius] of wanted) {
    if (placeAside(placement, lines, label, x, y, radius)) labels.push(label);
  }
  if (isFew) for (const mover of scene.singles) placement.block(roomFor(mover, view, scene, mover.id));
  labels.push(...placeStreets(view, scene, placement, reach));
  return { labels, taken: [...taken, ...labels] };
}

/** Room that other names leave a vehicle, and a text to its right. */
function roomFor(mover, view, { palette, style }, text) {
  const { width, height } = makeLabel("vehicle", mover.id, text, palette, { weight: 600 });
  const radius = VEHICLE_RADIUS[style];
  const x = view.px(mover.x) + width / 2;
  return { x, y: view.py(mover.y), width: width + 2 * radius + 4, height: Math.max(height, 2 * radius), angle: 0 };
}

/** Places beside a sign, the best first: right, left, over, under, and the corners. */
const BESIDE = [[1, 0], [-1, 0], [0, -1], [0, 1], [1, -1], [1, 1], [-1, -1], [-1, 1]];

/**
 * Give a label the first free place beside a sign.
 * @param {Placement} placement
 * @param {import("./paint/text.js").Label & {side?: number}} label
 * @param {number} x  of the sign, px
 * @param {number} y
 * @param {number} radius  of the sign, px
 * @param {number} [first]  number of the place to try first
 * @param {Placement} [lines]  what the label must keep clear of besides
 * @returns {boolean} whether there is one
 */
function placeBeside(placement, label, x, y, radius, first = 0, lines = undefined) {
  for (let i = -1; i < BESIDE.length; i++) {
    const side = i < 0 ? first : i;
    const [dx, dy] = BESIDE[side];
    const corner = dx && dy ? 0.75 : 1;
    label.x = x + dx * (corner * radius + 2 + label.width / 2);
    label.y = y + dy * (corner * radius + 1 + label.height / 2);
    if ((lines && !lines.isFree(label)) || !placement.take(label)) continue;
    label.side = side;
    return true;
  }
  return false;
}

/** The same clear of lines, at a greater distance if need be; on them, with a ground of its own, where nothing is clear. */
function placeAside(placement, lines, label, x, y, radius) {
  for (let aside = 0; aside <= MAX_ASIDE_PX; aside += ASIDE_STEP_PX) {
    if (placeBeside(placement, label, x, y, radius + aside, 0, lines)) return true;
  }
  label.plate = true;
  return placeBeside(placement, label, x, y, radius);
}

/** What roads' lines cover. @param {Map<number, number>} reach  px by road index */
function linesOf(view, network, reach, frame) {
  const [x0, y0, x1, y1] = view.bounds();
  const lines = new Placement(frame);
  for (const [road, width] of reach) {
    const { shape } = network.roads[road] ?? {};
    if (!shape || !isNear(shape, x0, y0, x1, y1)) continue;
    for (const box of boxesAlong(network.lineOf(road, view, width / 2), width)) lines.block(box);
  }
  return lines;
}

/** Whether a line of x and y has points on both sides of no edge of a box: it may lie in it. */
function isNear(line, x0, y0, x1, y1) {
  let [west, east, south, north] = [true, true, true, true];
  for (let i = 0; i < line.length; i += 2) {
    west &&= line[i] < x0;
    east &&= line[i] > x1;
    south &&= line[i + 1] < y0;
    north &&= line[i + 1] > y1;
  }
  return !(west || east || south || north);
}

/** Names along streets, important and long ones first. @param {Map<number, number>} reach  of roads' lines, px */
function placeStreets(view, scene, placement, reach) {
  const { chains, palette } = scene;
  const [x0, y0, x1, y1] = view.bounds();
  const seen = chains.filter(({ bounds: b }) => b[2] >= x0 && b[0] <= x1 && b[3] >= y0 && b[1] <= y1);
  seen.sort((a, b) => a.rank - b.rank || b.length - a.length);
  const placed = [];
  const most = (view.width * view.height) / STREET_NAME_PX2;
  for (const chain of seen) {
    if (placed.length >= most) break;
    const look = chain.rank < 2 ? { size: 11.5, weight: 600 } : { size: 10.5 };
    const model = makeLabel("street", chain.name, chain.name, palette, { ...look, colour: palette.inkSoft });
    const needed = PROMINENT[view.scale < NEAR ? 0 : 1];
    if (chain.length * view.scale < needed * model.width) continue;
    const line = view.project(chain.line);
    const total = lengthOf(line);
    const street = widthOf(chain.rank, view.scale);
    const clear = Math.max(...chain.roads.map((road) => reach.get(road) ?? 0)) || (street >= 16 ? 0 : street / 2);
    const beside = clear ? clear + model.height / 2 : 0;
    const count = Math.max(1, Math.floor(total / (model.width + REPEAT_PX)));
    for (let i = 0; i < count; i++) {
      const label = alongLine(line, ((i + 0.5) * total) / count, total / count, model, beside, placement, view);
      if (label) placed.push(label);
    }
  }
  return placed;
}

/** The name at the free place nearest to a distance along the line, within its share of the line. */
function alongLine(line, middle, share, model, beside, placement, view) {
  const room = Math.max(0, (share - model.width) / 2);
  const tries = Math.min(8, Math.ceil(room / 24));
  for (let i = 0; i <= 2 * tries; i++) {
    const shift = tries ? ((i % 2 ? 1 : -1) * Math.ceil(i / 2) * room) / tries : 0;
    const from = middle + shift - model.width / 2;
    const a = pointAlong(line, from);
    const b = pointAlong(line, from + model.width);
    if (isOutside(view, (a[0] + b[0]) / 2, (a[1] + b[1]) / 2)) continue;
    const chord = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (model.width - chord > BEND_PX / 2) continue;
    const between = pointAlong(line, from + model.width / 2);
    const bend = Math.abs((b[0] - a[0]) * (between[1] - a[1]) - (b[1] - a[1]) * (between[0] - a[0])) / chord;
    if (bend > BEND_PX) continue;
    let angle = Math.atan2(b[1] - a[1], b[0] - a[0]);
    // Read from the left; upright names from below.
    if (angle > Math.PI / 2 - 0.01) angle -= Math.PI;
    if (angle < -Math.PI / 2 - 0.01) angle += Math.PI;
    for (const side of beside ? [-1, 1] : [0]) {
      const label = {
        ...model,
        angle,
        x: (a[0] + b[0]) / 2 - side * beside * Math.sin(angle),
        y: (a[1] + b[1]) / 2 + side * beside * Math.cos(angle),
      };
      if (placement.take(label)) return label;
    }
  }
  return null;
}

/**
 * Names of vehicles where they are now, clear of all that stands still.
 * @param {import("./plane/view.js").View} view
 * @param {import("./scene.js").Scene} scene
 * @param {(import("./plane/placement.js").Box & {text?: string})[]} taken
 * @param {Map<string, number>} sides  by vehicle: the place beside it that its name had last; changed
 * @returns {import("./paint/text.js").Label[]}
 */
export function placeMoving(view, scene, taken, sides) {
  const { palette, relation, selection, style } = scene;
  const isNamed = (mover) => style !== "dot" || relation?.vehicles.has(mover.id);
  const named = [];
  for (const mover of scene.singles) {
    if (!isNamed(mover) || isOutside(view, view.px(mover.x), view.py(mover.y))) continue;
    named.push(mover);
  }
  if (!named.length) return [];
  const rank = (mover) =>
    selection?.id === mover.id ? 0 : relation?.vehicles.has(mover.id) ? 1 : mover.row.level === "bad" ? 1.5 : 3;
  named.sort((a, b) => rank(a) - rank(b) || (a.id < b.id ? -1 : 1));
  const frame = /** @type {[number, number, number, number]} */ ([0, 0, view.width, view.height]);
  const placement = new Placement(frame);
  for (const box of [...scene.covered, ...taken]) placement.block(box);
  const radius = VEHICLE_RADIUS[style];
  for (const mover of scene.singles) {
    const [x, y] = [view.px(mover.x), view.py(mover.y)];
    if (!isOutside(view, x, y)) placement.block({ x, y, width: 2 * radius - 2, height: 2 * radius - 2, angle: 0 });
  }
  for (const { x, y, radius: around } of scene.circles(view)) {
    placement.block({ x, y, width: 2 * around, height: 2 * around, angle: 0 });
  }
  // The selected vehicle's name may lie on signs, but on no other name.
  const names = new Placement(frame);
  for (const box of scene.covered) names.block(box);
  for (const box of taken) if (box.text) names.block(box);
  const placed = [];
  for (const mover of named.slice(0, MAX_VEHICLES)) {
    const isDimmed = relation && !relation.vehicles.has(mover.id);
    const isSilent = mover.row.state === "silent" && mover.row.level !== "idle";
    const label = makeLabel("vehicle", mover.id, isSilent ? `${mover.id}, silent ${age(mover.row.seen)}` : mover.id, palette, {
      weight: 600, colour: isDimmed ? palette.inkSoft : isSilent ? palette[mover.row.level] : palette.names[mover.row.colour ?? 0],
    });
    const halo = relation?.vehicles.has(mover.id) ? 8 : 1;
    const [x, y] = [view.px(mover.x), view.py(mover.y)];
    const isPlaced = placeBeside(placement, label, x, y, radius + halo, sides.get(mover.id));
    const isSelected = selection?.kind === "vehicle" && selection.id === mover.id;
    if (isPlaced || (isSelected && placeBeside(names, label, x, y, radius + halo))) {
      // Found among names alone, it is not yet known to those that follow.
      if (!isPlaced) placement.block(label);
      sides.set(mover.id, label.side);
      placed.push(label);
    }
  }
  return placed;
}
