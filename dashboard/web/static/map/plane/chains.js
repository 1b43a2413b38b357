/** Streets of one name that follow each other, as one line each: names are written along these. */

import { Grid } from "./grid.js";
import { boundsOf, lengthOf, reversed } from "./geometry.js";

/** Ends of a street that continues lie no farther apart than this, m. */
const GAP_M = 30;
/** Cosine of the sharpest turn at which a name goes on. */
const STRAIGHT = Math.cos((40 * Math.PI) / 180);

/**
 * @typedef {object} Chain
 * @property {string} name
 * @property {number[]} line  m
 * @property {number} rank  of its most important street
 * @property {number} length  m
 * @property {number[]} roads  road indices
 * @property {[number, number, number, number]} bounds  m
 */

/** @param {import("./network.js").Network} network @returns {Chain[]} */
export function chainsOf(network) {
  const byName = new Map();
  for (const street of network.streets) {
    const name = network.roads[street.roads[0]].name;
    if (!name) continue;
    byName.get(name)?.push(street) ?? byName.set(name, [street]);
  }
  return [...byName].flatMap(([name, streets]) => join(name, streets));
}

/** @returns {Chain[]} */
function join(name, streets) {
  const parts = streets.map(({ line, rank, roads }) => ({ line, rank, roads }));
  const grid = new Grid(200);
  const used = new Uint8Array(parts.length);
  parts.forEach(({ line }) => {
    grid.add([Math.min(line[0], line.at(-2)), Math.min(line[1], line.at(-1)),
      Math.max(line[0], line.at(-2)), Math.max(line[1], line.at(-1))]);
  });
  const chains = [];
  parts.forEach((part, number) => {
    if (used[number]) return;
    used[number] = 1;
    const chain = { name, line: [...part.line], rank: part.rank, roads: [...part.roads] };
    for (const _ of [0, 1]) {
      for (let next = follow(chain.line, parts, grid, used); next; next = follow(chain.line, parts, grid, used)) {
        used[next.number] = 1;
        chain.line.push(...next.line);
        chain.rank = Math.min(chain.rank, parts[next.number].rank);
        chain.roads.push(...parts[next.number].roads);
      }
      chain.line = reversed(chain.line);
    }
    chains.push({ ...chain, length: lengthOf(chain.line), bounds: boundsOf(chain.line) });
  });
  return chains;
}

/** The part that goes on where a line ends, in its direction. */
function follow(line, parts, grid, used) {
  const [x, y] = [line.at(-2), line.at(-1)];
  const ahead = unit(x - line.at(-4), y - line.at(-3));
  let best = null;
  for (const number of grid.near([x - GAP_M, y - GAP_M, x + GAP_M, y + GAP_M])) {
    if (used[number]) continue;
    for (const other of [parts[number].line, reversed(parts[number].line)]) {
      if (Math.hypot(other[0] - x, other[1] - y) > GAP_M) continue;
      const onward = unit(other[2] - other[0], other[3] - other[1]);
      const straight = ahead[0] * onward[0] + ahead[1] * onward[1];
      if (straight >= STRAIGHT && (!best || straight > best.straight)) best = { number, line: other, straight };
    }
  }
  return best;
}

function unit(x, y) {
  const length = Math.hypot(x, y) || 1;
  return [x / length, y / length];
}
