/** Boxes that never overlap: whoever comes first has the place. */

import { Grid } from "./grid.js";

/**
 * A turned rectangle on the screen.
 * @typedef {object} Box
 * @property {number} x  its middle, px
 * @property {number} y
 * @property {number} width
 * @property {number} height
 * @property {number} angle  rad, clockwise; 0 is upright
 */

/** Keeps boxes of labels, and of what labels must not cover. */
export class Placement {
  /** @param {[number, number, number, number]} frame  what is seen, px: its edge would cut a box that crosses it */
  constructor(frame) {
    this._frame = frame;
    this._grid = new Grid(64);
    /** @type {Box[]} */
    this._boxes = [];
  }

  /** Take a place whether it is free or not. @param {Box} box */
  block(box) {
    this._grid.add(around(box));
    this._boxes.push(box);
  }

  /** Whether a place overlaps none that is taken, and lies on one side of the frame's edge. @param {Box} box */
  isFree(box) {
    if (crosses(around(box), this._frame)) return false;
    for (const number of this._grid.near(around(box))) {
      if (overlap(box, this._boxes[number])) return false;
    }
    return true;
  }

  /** Take a place if it is free. @param {Box} box @returns {boolean} whether it was */
  take(box) {
    if (!this.isFree(box)) return false;
    this.block(box);
    return true;
  }
}

/**
 * Boxes that cover a line, one for each of its pieces.
 * @param {number[]} line  px
 * @param {number} width  of the line, px
 * @returns {Box[]}
 */
export function boxesAlong(line, width) {
  const boxes = [];
  for (let i = 2; i < line.length; i += 2) {
    const [x0, y0, x1, y1] = line.slice(i - 2, i + 2);
    boxes.push({
      x: (x0 + x1) / 2, y: (y0 + y1) / 2, width: Math.hypot(x1 - x0, y1 - y0), height: width, angle: Math.atan2(y1 - y0, x1 - x0),
    });
  }
  return boxes;
}

/** Whether two turned rectangles overlap, by the separating axes of both. @param {Box} a @param {Box} b */
export function overlap(a, b) {
  if (!a.angle && !b.angle) {
    return 2 * Math.abs(a.x - b.x) < a.width + b.width && 2 * Math.abs(a.y - b.y) < a.height + b.height;
  }
  const dx = b.x - a.x;
  const dy = b.y - a.y;
  for (const angle of [a.angle, a.angle + Math.PI / 2, b.angle, b.angle + Math.PI / 2]) {
    const x = Math.cos(angle);
    const y = Math.sin(angle);
    if (Math.abs(dx * x + dy * y) >= reach(a, angle) + reach(b, angle)) return false;
  }
  return true;
}

/** Whether a part of a box lies inside a frame, and a part of it outside. */
function crosses([left, top, right, bottom], [x0, y0, x1, y1]) {
  if (right <= x0 || left >= x1 || bottom <= y0 || top >= y1) return false;
  return left < x0 || right > x1 || top < y0 || bottom > y1;
}

/** Half of a box's shadow on an axis. */
function reach(box, axis) {
  const turn = axis - box.angle;
  return (Math.abs(Math.cos(turn)) * box.width + Math.abs(Math.sin(turn)) * box.height) / 2;
}

/** @returns {[number, number, number, number]} */
function around(box) {
  const x = reach(box, 0);
  const y = reach(box, Math.PI / 2);
  return [box.x - x, box.y - y, box.x + x, box.y + y];
}
