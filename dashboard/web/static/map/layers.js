/** What stands still, kept as pictures that are drawn anew only when they show something else. */

import { placeStill } from "./labels.js";
import { paintGround, paintState } from "./paint/painting.js";
import { drawLabels } from "./paint/text.js";

/** Drawn on all sides beyond what is seen, so that a short pan needs no drawing, px. */
const MARGIN = 128;
/** While a gesture lasts, slower drawing than this, in ms, gives way to stretched pictures... */
const SLOW_MS = 12;
/** ...for so long, ms, and for so many times as long as it took. */
const MAX_AGE_MS = 120;
const MAX_AGE_COSTS = 4;

export class Layers {
  constructor() {
    this._ground = document.createElement("canvas");
    this._state = document.createElement("canvas");
    /** @type {import("./plane/view.js").View|null} what the pictures show */
    this._shown = null;
    this._ratio = 1;
    this._isStale = true;
    this._drawnAt = -Infinity;
    this._cost = 0;
    /** @type {import("./paint/text.js").Label[]} */
    this._labels = [];
    /** @type {import("./plane/placement.js").Box[]} */
    this._taken = [];
  }

  /** The next drawing begins with the streets. */
  discard() {
    this._shown = null;
  }

  /** Flags, routes, signs or names have changed. */
  outdate() {
    this._isStale = true;
  }

  /**
   * Have the pictures show a view.
   * @param {import("./plane/view.js").View} view
   * @param {import("./scene.js").Scene} scene
   * @param {number} ratio  device pixels a px
   * @param {boolean} isMoving  a gesture is under way
   * @param {number} now  ms
   * @returns {boolean} whether they show it as it is, and not stretched
   */
  refresh(view, scene, ratio, isMoving, now) {
    const isCovered = this._shown !== null && ratio === this._ratio && this._covers(view);
    if (isCovered && !this._isStale) return true;
    const isYoung = now - this._drawnAt < Math.max(MAX_AGE_MS, MAX_AGE_COSTS * this._cost);
    if (isMoving && this._shown && ratio === this._ratio && isYoung && this._cost > SLOW_MS) return isCovered;
    if (!isCovered) {
      this._shown = view.widened(MARGIN);
      this._ratio = ratio;
      paintGround(this._begin(this._ground), this._shown, scene);
    }
    const context = this._begin(this._state);
    context.drawImage(this._ground, 0, 0, this._shown.width, this._shown.height);
    paintState(context, this._shown, scene);
    const { labels, taken } = placeStill(this._shown, scene, MARGIN);
    drawLabels(context, labels, scene.palette.halo);
    [this._labels, this._taken] = [labels, taken];
    this._isStale = false;
    this._drawnAt = performance.now();
    this._cost = this._drawnAt - now;
    return true;
  }

  /** Whether the pictures have a view's scale, and all of it. */
  _covers(view) {
    const shown = this._shown;
    if (Math.abs(shown.scale / view.scale - 1) > 1e-9) return false;
    if (shown.width !== view.width + 2 * MARGIN || shown.height !== view.height + 2 * MARGIN) return false;
    const right = Math.abs(view.x - shown.x) * view.scale;
    const down = Math.abs(view.y - shown.y) * view.scale;
    return right <= MARGIN && down <= MARGIN;
  }

  _begin(canvas) {
    const width = Math.round(this._shown.width * this._ratio);
    const height = Math.round(this._shown.height * this._ratio);
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const context = canvas.getContext("2d", { alpha: false });
    context.setTransform(this._ratio, 0, 0, this._ratio, 0, 0);
    return context;
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {import("./plane/view.js").View} view
   * @param {string} land  colour of what the picture does not reach
   */
  draw(context, view, land) {
    const [x, y, factor] = this._placeIn(view);
    const shown = this._shown;
    if (factor !== 1) {
      context.fillStyle = land;
      context.fillRect(0, 0, view.width, view.height);
    }
    context.drawImage(this._state, x, y, shown.width * factor, shown.height * factor);
  }

  /** Where the picture's corner lies in a view, and how much it is stretched. */
  _placeIn(view) {
    const shown = this._shown;
    const ratio = view.scale / shown.scale;
    const factor = Math.abs(ratio - 1) < 1e-9 ? 1 : ratio;
    const snap = (value) => (factor === 1 ? Math.round(value * this._ratio) / this._ratio : value);
    return [snap(view.px(shown.mx(0))), snap(view.py(shown.my(0))), factor];
  }

  /** Names that stand still, as they lie in a view. @param {import("./plane/view.js").View} view */
  labels(view) {
    return this._shown ? this._moved(this._labels, view) : [];
  }

  /** What names of vehicles must keep clear of, in a view. @param {import("./plane/view.js").View} view */
  taken(view) {
    return this._shown ? this._moved(this._taken, view) : [];
  }

  _moved(boxes, view) {
    const [x, y, factor] = this._placeIn(view);
    return boxes.map((box) => ({
      ...box,
      x: box.x * factor + x,
      y: box.y * factor + y,
      width: box.width * factor,
      height: box.height * factor,
    }));
  }
}
