/**
 * Geometry of lines in a plane: simplification, offsets, distances.
 * A line is a flat array [x, y, x, y, ...] of at least two points.
 * @module
 */

/** @typedef {number[]} Line */

/**
 * The line with fewer points, by Douglas and Peucker.
 * @param {Line} line
 * @param {number} tolerance  most that a left-out point lies from the new line, in the line's unit
 * @returns {Line}
 */
export function simplify(line, tolerance) {
  const count = line.length / 2;
  if (count <= 2) return line;
  const keep = new Uint8Array(count);
  keep[0] = keep[count - 1] = 1;
  const open = [[0, count - 1]];
  while (open.length) {
    const [first, last] = open.pop();
    let farthest = -1;
    let most = tolerance * tolerance;
    for (let i = first + 1; i < last; i++) {
      const away = squaredDistance(
        line[2 * i], line[2 * i + 1],
        line[2 * first], line[2 * first + 1], line[2 * last], line[2 * last + 1],
      );
      if (away > most) [most, farthest] = [away, i];
    }
    if (farthest < 0) continue;
    keep[farthest] = 1;
    open.push([first, farthest], [farthest, last]);
  }
  const kept = [];
  for (let i = 0; i < count; i++) if (keep[i]) kept.push(line[2 * i], line[2 * i + 1]);
  return kept;
}

/** Squared distance of a point from the stroke a-b. */
function squaredDistance(x, y, ax, ay, bx, by) {
  const dx = bx - ax;
  const dy = by - ay;
  const square = dx * dx + dy * dy;
  const part = square ? Math.max(0, Math.min(1, ((x - ax) * dx + (y - ay) * dy) / square)) : 0;
  return (ax + part * dx - x) ** 2 + (ay + part * dy - y) ** 2;
}

/** Distance of a point from a line. @param {number} x @param {number} y @param {Line} line @returns {number} */
export function distanceToLine(x, y, line) {
  let nearest = Infinity;
  for (let i = 2; i < line.length; i += 2) {
    const away = squaredDistance(x, y, line[i - 2], line[i - 1], line[i], line[i + 1]);
    if (away < nearest) nearest = away;
  }
  return Math.sqrt(nearest);
}

/**
 * The line moved to its right, with mitred corners; on a screen, where y grows downwards.
 * @param {Line} line
 * @param {number} distance  in the line's unit
 * @returns {Line}
 */
export function offset(line, distance) {
  const count = line.length / 2;
  const moved = new Array(line.length);
  let beforeX = 0;
  let beforeY = 0;
  for (let i = 0; i < count; i++) {
    let afterX = beforeX;
    let afterY = beforeY;
    if (i < count - 1) {
      const dx = line[2 * i + 2] - line[2 * i];
      const dy = line[2 * i + 3] - line[2 * i + 1];
      const length = Math.hypot(dx, dy);
      if (length > 1e-9) [afterX, afterY] = [-dy / length, dx / length];
    }
    if (i === 0) [beforeX, beforeY] = [afterX, afterY];
    const x = beforeX + afterX;
    const y = beforeY + afterY;
    // A sharp corner has a long mitre, and a U-turn has none.
    const reach = distance * Math.min(2, 2 / Math.max(x * x + y * y, 1e-9));
    moved[2 * i] = line[2 * i] + reach * x;
    moved[2 * i + 1] = line[2 * i + 1] + reach * y;
    [beforeX, beforeY] = [afterX, afterY];
  }
  return moved;
}

/** Length of a line. @param {Line} line @returns {number} */
export function lengthOf(line) {
  let length = 0;
  for (let i = 2; i < line.length; i += 2) {
    length += Math.hypot(line[i] - line[i - 2], line[i + 1] - line[i - 1]);
  }
  return length;
}

/** The point at a distance along a line; its ends beyond them. @param {Line} line @param {number} distance @returns {[number, number]} */
export function pointAlong(line, distance) {
  for (let i = 2; i < line.length; i += 2) {
    const step = Math.hypot(line[i] - line[i - 2], line[i + 1] - line[i - 1]);
    if (distance <= step && step > 0) {
      const part = Math.max(0, distance) / step;
      return [
        line[i - 2] + part * (line[i] - line[i - 2]),
        line[i - 1] + part * (line[i + 1] - line[i - 1]),
      ];
    }
    distance -= step;
  }
  return [line.at(-2), line.at(-1)];
}

/** The same line driven the other way. @param {Line} line @returns {Line} */
export function reversed(line) {
  const back = new Array(line.length);
  for (let i = 0; i < line.length; i += 2) {
    back[i] = line[line.length - 2 - i];
    back[i + 1] = line[line.length - 1 - i];
  }
  return back;
}

/** The box around a line: [x0, y0, x1, y1]. @param {Line} line @returns {[number, number, number, number]} */
export function boundsOf(line) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (let i = 0; i < line.length; i += 2) {
    box[0] = Math.min(box[0], line[i]);
    box[1] = Math.min(box[1], line[i + 1]);
    box[2] = Math.max(box[2], line[i]);
    box[3] = Math.max(box[3], line[i + 1]);
  }
  return /** @type {[number, number, number, number]} */ (box);
}
