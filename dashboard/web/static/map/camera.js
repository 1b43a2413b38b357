/** Which part of the plane is seen, and how the map comes from one to another. */

import { View } from "./plane/view.js";

const FLIGHT_MS = 260;
/** A gesture is over when nothing has moved for so long, ms. */
export const SETTLED_MS = 90;

export class Camera {
  /** @param {boolean} reducedMotion  nothing glides */
  constructor(reducedMotion) {
    this.view = new View();
    /** Whether all is seen, also when the container gets another size. */
    this.isFitted = true;
    this._reducedMotion = reducedMotion;
    /** @type {{from: View, to: View, begin: number}|null} */
    this._flight = null;
    this._movedAt = -Infinity;
  }

  get isFlying() {
    return this._flight !== null;
  }

  /** @param {number} now  ms */
  isMoving(now) {
    return now - this._movedAt < SETTLED_MS;
  }

  /** A change by a gesture. @param {(view: View) => void} change */
  change(change) {
    this._flight = null;
    this.isFitted = false;
    change(this.view);
    this._movedAt = performance.now();
  }

  /** @param {number} factor  more than 1: nearer */
  zoom(factor) {
    const goal = Object.assign(new View(), this._flight?.to ?? this.view);
    goal.zoom(factor);
    this.fly(goal);
  }

  /** @param {View} view  where to */
  fly(view) {
    this.isFitted = false;
    this._flight = { from: Object.assign(new View(), this.view), to: view, begin: performance.now() };
    if (this._reducedMotion || document.hidden) this.advance(Infinity);
  }

  /** @param {[number, number, number, number]} bounds  of all that there is, m @param {{right: number, bottom: number}} [margin]  px */
  fit(bounds, margin) {
    const whole = this.view.fitted(bounds, margin);
    this.view.minScale = whole.minScale = whole.scale / 2;
    this.fly(whole);
    this.isFitted = true;
  }

  /**
   * Take over the container's size, px.
   * @param {number} width
   * @param {number} height
   * @param {[number, number, number, number]} bounds  of all that there is, m
   * @param {{right: number, bottom: number}} [margin]  px
   */
  resize(width, height, bounds, margin) {
    Object.assign(this.view, { width, height });
    if (!this.isFitted) return;
    this.fit(bounds, margin);
    this.advance(Infinity);
  }

  /** Come nearer to where a flight leads. @param {number} now  ms */
  advance(now) {
    if (!this._flight) return;
    const { from, to, begin } = this._flight;
    const part = Math.min(1, (now - begin) / FLIGHT_MS);
    const eased = 1 - (1 - part) ** 3;
    const { view } = this;
    view.scale = part === 1 ? to.scale : from.scale * (to.scale / from.scale) ** eased;
    // Seen places move evenly when the middle follows the scale, not the time.
    const change = 1 / to.scale - 1 / from.scale;
    const isPan = Math.abs(change * from.scale) < 1e-3;
    const share = part === 1 ? 1 : isPan ? eased : (1 / view.scale - 1 / from.scale) / change;
    view.x = from.x + share * (to.x - from.x);
    view.y = from.y + share * (to.y - from.y);
    this._movedAt = now === Infinity ? -Infinity : now;
    if (part === 1) this._flight = null;
  }
}
