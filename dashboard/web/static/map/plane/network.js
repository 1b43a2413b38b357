/** The road network as the map draws it: streets of both directions, their detail by scale. */

import { boundsOf, distanceToLine, offset, reversed, simplify } from "./geometry.js";
import { Grid } from "./grid.js";

/**
 * Both directions of a street, or the one that it has.
 * @typedef {object} Street
 * @property {number[]} line  its middle, m, in the first direction
 * @property {number} rank  0: motorways, 1: main roads, 2: others
 * @property {number[]} roads  road indices: one or two
 * @property {Map<number, number[]>} details  the line by level of detail
 */

/** Widths of streets by rank: m, and the fewest and most pixels. */
const WIDTH_M = [14, 10, 7];
const MIN_WIDTH_PX = [2.4, 1.7, 0.9];
const MAX_WIDTH_PX = 40;
/** Ends of streets so near each other, in m, belong to one junction. */
const JUNCTION_M = 22;
/** The two directions of a street may lie so far apart, m. */
const TWIN_M = 14;
const LOWEST_DETAIL = -12;

/** Roads of the contract, prepared to be drawn and found. */
export class Network {
  /** @param {object} data  answer of /api/network */
  constructor(data) {
    /** @type {{id: string, name: string|null, shape: number[], limit_kmh: number, lanes: number, length_m: number}[]} */
    this.roads = data.roads;
    this.depots = data.depots ?? [];
    /** Where the roads lie beside their street's middle: 1 to the right of it, -1 to the left. */
    this.side = data.left_hand ? -1 : 1;
    /** @type {Map<string, number>} */
    this.index = new Map(this.roads.map((road, index) => [road.id, index]));
    /** @type {Street[]} */
    this.streets = pair(this.roads);
    /** Street of each road, and whether the road runs along its line. */
    this.streetOf = new Int32Array(this.roads.length);
    this.isForward = new Uint8Array(this.roads.length);
    this.streets.forEach((street, number) => street.roads.forEach((road, side) => {
      this.streetOf[road] = number;
      this.isForward[road] = side === 0 ? 1 : 0;
    }));
    joinEnds(this.streets);
    const boxes = this.streets.map((street) => boundsOf(street.line));
    this.bounds = data.bounds ?? union(boxes);
    const span = Math.max(this.bounds[2] - this.bounds[0], this.bounds[3] - this.bounds[1], 1);
    this._grid = new Grid(span / 64);
    boxes.forEach((box) => this._grid.add(box));
  }

  /** Numbers of the streets in a box, and perhaps of some beside it. @param {[number, number, number, number]} box  m */
  streetsNear(box) {
    return this._grid.near(box);
  }

  /** A street's line with no more detail than a scale shows. @param {Street} street @param {number} scale  px a metre */
  detail(street, scale) {
    if (street.line.length <= 4) return street.line;
    const level = Math.max(LOWEST_DETAIL, Math.ceil(Math.log2(scale)));
    let line = street.details.get(level);
    if (!line) street.details.set(level, (line = simplify(street.line, 0.5 / 2 ** level)));
    return line;
  }

  /**
   * A road's line on the screen, moved from its street's middle to the side that is driven on.
   * @param {number} road  road index
   * @param {import("./view.js").View} view
   * @param {number} aside  px
   */
  lineOf(road, view, aside) {
    const street = this.streets[this.streetOf[road]];
    const line = this.detail(street, view.scale);
    const driven = view.project(this.isForward[road] ? line : reversed(line));
    const right = this.side * aside;
    return right ? offset(driven, street.roads.length > 1 ? right : right / 2) : driven;
  }

  /**
   * Road nearest to a pixel; of a street's two directions the one on whose side it lies.
   * @param {import("./view.js").View} view
   * @param {number} px
   * @param {number} py
   * @param {number} within  px
   * @param {(road: number) => number} bonus  px by which a road counts as nearer
   * @returns {{road: number, away: number}|null}
   */
  nearest(view, px, py, within, bonus) {
    const [x, y, reach] = [view.mx(px), view.my(py), (within + MAX_WIDTH_PX / 2) / view.scale];
    /** @type {{road: number, away: number, rated: number}|null} */
    let best = null;
    for (const number of this.streetsNear([x - reach, y - reach, x + reach, y + reach])) {
      const street = this.streets[number];
      const side = Math.max(2.5, widthOf(street.rank, view.scale) / 4);
      for (const road of street.roads) {
        const away = distanceToLine(px, py, this.lineOf(road, view, side));
        if (away > within + side) continue;
        const rated = away - bonus(road);
        if (!best || rated < best.rated) best = { road, away, rated };
      }
    }
    return best;
  }
}

/** Width of a street on the screen, px. @param {number} rank @param {number} scale  px a metre */
export function widthOf(rank, scale) {
  return Math.min(MAX_WIDTH_PX, Math.max(MIN_WIDTH_PX[rank], WIDTH_M[rank] * scale));
}

/** @returns {number} */
function rankOf(road) {
  if (road.limit_kmh >= 80) return 0;
  return road.limit_kmh > 52 || road.lanes > 1 ? 1 : 2;
}

/** Streets of the roads: two roads between the same ends, driven opposite ways, are one. @returns {Street[]} */
function pair(roads) {
  const cell = (x, y) => `${Math.round(x / 40)},${Math.round(y / 40)}`;
  const byStart = new Map();
  roads.forEach((road, index) => {
    const key = cell(road.shape[0], road.shape[1]);
    byStart.get(key)?.push(index) ?? byStart.set(key, [index]);
  });
  const taken = new Uint8Array(roads.length);
  const streets = [];
  roads.forEach((road, index) => {
    if (taken[index]) return;
    taken[index] = 1;
    const [x, y] = [road.shape.at(-2), road.shape.at(-1)];
    let twin = -1;
    let nearest = TWIN_M;
    for (const dx of [-40, 0, 40]) {
      for (const dy of [-40, 0, 40]) {
        for (const other of byStart.get(cell(x + dx, y + dy)) ?? []) {
          const away = apart(road.shape, roads[other].shape);
          if (!taken[other] && away < nearest) [twin, nearest] = [other, away];
        }
      }
    }
    if (twin >= 0) taken[twin] = 1;
    const line = twin < 0 ? road.shape : middle(road.shape, reversed(roads[twin].shape));
    const rank = Math.min(rankOf(road), twin < 0 ? 2 : rankOf(roads[twin]));
    const both = twin < 0 ? [index] : [index, twin];
    streets.push({ line: [...line], rank, roads: both, details: new Map() });
  });
  return streets;
}

/** How far the ends and middles of two opposite roads lie apart at most. */
function apart(a, b) {
  const back = reversed(b);
  const ends = Math.max(
    Math.hypot(a[0] - back[0], a[1] - back[1]),
    Math.hypot(a.at(-2) - back.at(-2), a.at(-1) - back.at(-1)),
  );
  if (ends > TWIN_M) return Infinity;
  const half = 2 * Math.floor(a.length / 4);
  return Math.max(ends, distanceToLine(a[half], a[half + 1], b));
}

/** The line midway between two of as many points; the first if they differ. */
function middle(a, b) {
  return a.length === b.length ? a.map((value, i) => (value + b[i]) / 2) : a;
}

/** Lead the ends of streets to the middles of their junctions, so that no gap is drawn there. */
function joinEnds(streets) {
  const ends = streets.flatMap(({ line }) => [[line[0], line[1]], [line.at(-2), line.at(-1)]]);
  const grid = new Grid(JUNCTION_M);
  const parent = ends.map((_, i) => i);
  const root = (i) => {
    while (parent[i] !== i) i = parent[i] = parent[parent[i]];
    return i;
  };
  ends.forEach(([x, y], i) => {
    for (const j of grid.near([x - JUNCTION_M, y - JUNCTION_M, x + JUNCTION_M, y + JUNCTION_M])) {
      const near = Math.hypot(ends[j][0] - x, ends[j][1] - y) < JUNCTION_M;
      // Both ends of a short street are two junctions.
      if (near && i >> 1 !== j >> 1) parent[root(i)] = root(j);
    }
    grid.add([x, y, x, y]);
  });
  const sums = new Map();
  ends.forEach(([x, y], i) => {
    const sum = sums.get(root(i)) ?? [0, 0, 0];
    sums.set(root(i), [sum[0] + x, sum[1] + y, sum[2] + 1]);
  });
  streets.forEach((street, number) => {
    const [first, last] = [root(2 * number), root(2 * number + 1)];
    if (first === last) return;
    for (const [end, at] of [[first, 0], [last, street.line.length]]) {
      const [x, y, count] = sums.get(end);
      const from = at ? at - 2 : 0;
      const away = Math.hypot(x / count - street.line[from], y / count - street.line[from + 1]);
      if (away < 0.5 || away > 2 * JUNCTION_M) continue;
      street.line.splice(at ? street.line.length : 0, 0, x / count, y / count);
    }
  });
}

function union(boxes) {
  const all = [Infinity, Infinity, -Infinity, -Infinity];
  for (const box of boxes) {
    for (const i of [0, 1]) all[i] = Math.min(all[i], box[i]);
    for (const i of [2, 3]) all[i] = Math.max(all[i], box[i]);
  }
  return boxes.length ? all : [0, 0, 1, 1];
}
