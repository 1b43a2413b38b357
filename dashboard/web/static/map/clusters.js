/** Vehicles whose signs would lie on each other, as one sign with their number. */

import { Grid } from "./plane/grid.js";

/**
 * @typedef {object} Cluster
 * @property {import("./motion.js").Mover[]} members  at least two, by id
 * @property {number} radius  of its sign, px
 */

/**
 * Groups of signs that overlap; grown until the groups' own signs overlap none either.
 * @param {import("./motion.js").Mover[]} movers
 * @param {number} scale  px a metre
 * @param {number} apart  least distance of two vehicles that are shown singly, px
 * @returns {Cluster[]}
 */
export function clusters(movers, scale, apart) {
  let groups = movers.map((mover) => ({ members: [mover], x: mover.x * scale, y: mover.y * scale, radius: apart / 2 }));
  for (;;) {
    const merged = mergeOnce(groups);
    if (merged.length === groups.length) break;
    groups = merged;
  }
  return groups
    .filter((group) => group.members.length > 1)
    .map(({ members, radius }) => ({ members: members.sort((a, b) => (a.id < b.id ? -1 : 1)), radius }));
}

function mergeOnce(groups) {
  const widest = 2 * Math.max(...groups.map((group) => group.radius), 1);
  const grid = new Grid(widest);
  const kept = [];
  for (const group of groups) {
    const { x, y } = group;
    let into = null;
    for (const number of grid.near([x - widest, y - widest, x + widest, y + widest])) {
      const other = kept[number];
      if (Math.hypot(other.x - x, other.y - y) < other.radius + group.radius) {
        into = other;
        break;
      }
    }
    if (!into) {
      grid.add([x, y, x, y]);
      kept.push(group);
      continue;
    }
    const members = [...into.members, ...group.members];
    // The place in the grid stays the first one's; the next pass sees where the group has come to.
    const share = group.members.length / members.length;
    into.x += share * (x - into.x);
    into.y += share * (y - into.y);
    into.members = members;
    into.radius = radiusOf(members.length);
  }
  return kept;
}

/** Radius of a group's sign, px: its area grows with the number's logarithm. */
function radiusOf(count) {
  return 8 + 2 * Math.log2(count) ** 0.8;
}

/** Middle of a cluster where its vehicles are now, m. @param {Cluster} cluster @returns {[number, number]} */
export function middleOf(cluster) {
  let x = 0;
  let y = 0;
  for (const mover of cluster.members) {
    x += mover.x;
    y += mover.y;
  }
  return [x / cluster.members.length, y / cluster.members.length];
}
