/** Pointers, wheel and keys of the map's canvas, told as pans, zooms and clicks. */

const DRAG_PX = 4;
const KEY_PAN_PX = 80;
const KEY_ZOOM = 1.5;
const DOUBLE_ZOOM = 2;
/** Zoom of one px of a wheel's turn; of a pinch on a touch pad, which sends ctrl+wheel. */
const WHEEL_ZOOM = 0.0016;
const PAD_ZOOM = 0.01;
const MAX_WHEEL_PX = 200;
const LINE_PX = 16;

/**
 * @typedef {object} Handlers
 * @property {(right: number, down: number) => void} pan  px
 * @property {(factor: number, x?: number, y?: number) => void} zoom
 * @property {(x: number, y: number, isTouch: boolean) => void} click
 * @property {(x: number, y: number) => void} hover
 * @property {() => void} leave
 * @property {() => void} fit
 */

export class Gestures {
  /** @param {HTMLElement} canvas @param {Handlers} handlers */
  constructor(canvas, handlers) {
    this._canvas = canvas;
    this._on = handlers;
    /** @type {Map<number, {x: number, y: number}>} pointers that are down */
    this._down = new Map();
    this._start = null;
    const listen = (/** @type {string} */ name, /** @type {(event: any) => void} */ handle) =>
      canvas.addEventListener(name, handle, { passive: false });
    listen("pointerdown", (event) => this._press(event));
    listen("pointermove", (event) => this._move(event));
    listen("pointerup", (event) => this._release(event, true));
    listen("pointercancel", (event) => this._release(event, false));
    listen("pointerleave", () => this._on.leave());
    listen("wheel", (event) => this._wheel(event));
    listen("dblclick", (event) => this._on.zoom(event.shiftKey ? 1 / DOUBLE_ZOOM : DOUBLE_ZOOM, ...this._place(event)));
    listen("keydown", (event) => this._key(event));
  }

  /** @returns {[number, number]} px from the canvas' corner */
  _place(event) {
    const box = this._canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  _press(event) {
    if (event.pointerType === "mouse" && event.button !== 0) return;
    const [x, y] = this._place(event);
    this._down.set(event.pointerId, { x, y });
    // A second finger makes it a pinch, not a click.
    this._start = this._down.size === 1 ? { x, y } : null;
    this._canvas.setPointerCapture(event.pointerId);
  }

  _move(event) {
    const [x, y] = this._place(event);
    const pointer = this._down.get(event.pointerId);
    if (!pointer) {
      if (event.pointerType === "mouse") this._on.hover(x, y);
      return;
    }
    if (this._start) {
      if (Math.hypot(x - this._start.x, y - this._start.y) < DRAG_PX) return;
      this._start = null;
      this._canvas.dataset.dragged = "";
      this._on.leave();
    }
    const before = this._spread();
    [pointer.x, pointer.y] = [x, y];
    const after = this._spread();
    this._on.pan(after.x - before.x, after.y - before.y);
    if (before.size > 0 && after.size > 0) this._on.zoom(after.size / before.size, after.x, after.y);
  }

  /** Middle of the pointers, and how far they lie from it on average. */
  _spread() {
    const all = [...this._down.values()];
    const x = all.reduce((sum, pointer) => sum + pointer.x, 0) / all.length;
    const y = all.reduce((sum, pointer) => sum + pointer.y, 0) / all.length;
    const size = all.reduce((sum, pointer) => sum + Math.hypot(pointer.x - x, pointer.y - y), 0) / all.length;
    return { x, y, size };
  }

  _release(event, isDone) {
    if (!this._down.delete(event.pointerId)) return;
    const start = this._start;
    this._start = null;
    delete this._canvas.dataset.dragged;
    if (isDone && start) this._on.click(start.x, start.y, event.pointerType !== "mouse");
  }

  _wheel(event) {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? LINE_PX : event.deltaMode === 2 ? 400 : 1);
    const turned = Math.max(-MAX_WHEEL_PX, Math.min(MAX_WHEEL_PX, pixels));
    this._on.zoom(Math.exp(-turned * (event.ctrlKey ? PAD_ZOOM : WHEEL_ZOOM)), ...this._place(event));
  }

  _key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const actions = {
      ArrowLeft: () => this._on.pan(KEY_PAN_PX, 0),
      ArrowRight: () => this._on.pan(-KEY_PAN_PX, 0),
      ArrowUp: () => this._on.pan(0, KEY_PAN_PX),
      ArrowDown: () => this._on.pan(0, -KEY_PAN_PX),
      "+": () => this._on.zoom(KEY_ZOOM),
      "=": () => this._on.zoom(KEY_ZOOM),
      "-": () => this._on.zoom(1 / KEY_ZOOM),
      0: () => this._on.fit(),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  }
}
