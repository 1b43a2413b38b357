/** The city's map on a 2D canvas: roads by their flag, vehicles, roadside units, orders. */

import { Camera, SETTLED_MS } from "./camera.js";
import { Controls } from "./controls.js";
import { Gestures } from "./gestures.js";
import { pick } from "./hit.js";
import { placeMoving } from "./labels.js";
import { Layers } from "./layers.js";
import { paintVehicles } from "./paint/painting.js";
import { loadStyles, readPalette } from "./paint/palette.js";
import { pictureOf } from "./picture.js";
import { Scene } from "./scene.js";
import { drawLabels } from "./paint/text.js";
import { describe, summary } from "./words.js";

const POINTER_PX = 8;
const FINGER_PX = 16;
const BUTTON_ZOOM = 1.6;
/** What is shown alone is shown at this scale at least and at most, px a metre. */
const SHOWN_SCALE = [0.35, 1.5];
/** Vehicles are drawn again once the fastest has gone so far, px... */
const STEP_PX = 0.5;
/** ...after so many ms at least and at most. */
const STEP_MS = [33, 250];
const SUMMARY_MS = 5000;
/** Vehicles nearer to each other than this, in m, no zoom can part. */
const ONE_PLACE_M = 4;

export class CityMap {
  /**
   * @param {HTMLElement} container  has a size; gets the class `city-map`
   * @param {object} options
   * @param {(kind: string|null, id: string|null) => void} options.onSelect  something was clicked;
   *   nulls: nothing is there
   * @param {boolean} [options.reducedMotion]  nothing glides
   * @param {"metric"|"imperial"} [options.units]
   */
  constructor(container, { onSelect, reducedMotion = false, units = "metric" }) {
    this._root = container;
    this._onSelect = onSelect;
    this._units = units;
    this._scene = new Scene(reducedMotion);
    this._layers = new Layers();
    this._camera = new Camera(reducedMotion);
    this._view = this._camera.view;
    container.classList.add("city-map");
    this._canvas = document.createElement("canvas");
    this._canvas.className = "map-canvas";
    this._canvas.tabIndex = 0;
    this._canvas.setAttribute("role", "img");
    container.append(this._canvas);
    this._context = this._canvas.getContext("2d", { alpha: false });
    this._controls = new Controls(container, {
      zoomIn: () => this._move((camera) => camera.zoom(BUTTON_ZOOM)),
      zoomOut: () => this._move((camera) => camera.zoom(1 / BUTTON_ZOOM)),
      fit: () => this.fit(),
      cover: () => this._covered(),
    }, units);
    this._gestures = new Gestures(this._canvas, {
      pan: (right, down) => this._change((view) => view.pan(right, down)),
      zoom: (factor, x, y) => this._change((view) => view.zoom(factor, x, y)),
      click: (x, y, isTouch) => this._click(x, y, isTouch),
      hover: (x, y) => this._hover([x, y]),
      leave: () => this._hover(null),
      fit: () => this.fit(),
    });
    /** @type {Map<string, number>} */
    this._sides = new Map();
    /** @type {import("./paint/text.js").Label[]} */
    this._moving = [];
    this._summedAt = -Infinity;
    this._pointer = null;
    this._hovered = "";
    this._request = 0;
    this._timer = 0;
    new ResizeObserver(() => this._resize()).observe(container);
    loadStyles().then(() => this.setTheme(this._root.dataset.theme === "dark" ? "dark" : "light"));
  }

  /** @param {object} network  answer of /api/network; all of it is shown */
  setNetwork(network) {
    this._scene.setNetwork(network);
    this._layers.discard();
    this._resize();
    this.fit();
  }

  /**
   * Show rows. The maps may be changed in place between two calls.
   * @param {{vehicles: Map<string, any>, roads: Map<string, any>, rsus: Map<string, any>,
   *   orders: Map<string, any>}} tables
   * @param {Record<string, Set<string>>|null} changed  ids by table; null: all, at once
   */
  setMoment(tables, changed) {
    const now = performance.now();
    this._scene.motion.advance(now);
    if (this._scene.setMoment(tables, changed, now)) this._layers.outdate();
    this._describe(now);
    if (this._pointer) this._hover(this._pointer);
    this._draw();
  }

  /** @param {string|null} kind  vehicle, road, rsu or order; null: nothing @param {string} [id] */
  select(kind, id) {
    this._scene.select(kind, id ?? null);
    this._layers.outdate();
    this._describe(Infinity);
    this._draw();
  }

  /** Move to where something is, if it has a place. @param {string} kind @param {string} id */
  show(kind, id) {
    const bounds = this._scene.boundsOf(kind, id);
    if (!bounds) return;
    const view = this._view.fitted(bounds, Math.min(this._view.width, this._view.height) / 4);
    const [least, most] = SHOWN_SCALE;
    view.scale = Math.min(view.scale, Math.max(least, Math.min(most, this._view.scale)));
    this._move((camera) => camera.fly(view));
  }

  /** Show the whole network. */
  fit() {
    this._move((camera) => camera.fit(this._scene.network.bounds, this._controls.margin()));
  }

  /**
   * The part that is seen as a picture, with legend, time and scale.
   * @param {{text?: string}} [options]  what stands over it; else the present time
   * @returns {Promise<Blob>}
   */
  toPNG({ text } = {}) {
    const time = new Date().toLocaleString([], { dateStyle: "medium", timeStyle: "long" });
    this._scene.group(this._view);
    return pictureOf(this._view, this._scene, text ?? time, this._units);
  }

  /** @param {"light"|"dark"} [theme]  by the system if not given */
  setTheme(theme) {
    const isDark = matchMedia("(prefers-color-scheme: dark)").matches;
    this._root.dataset.theme = theme ?? (isDark ? "dark" : "light");
    const palette = readPalette(this._root);
    // Before the style sheet is there no colour is known.
    if (!palette.land) return;
    this._scene.palette = palette;
    this._controls.setPalette(palette, devicePixelRatio);
    this._layers.discard();
    this._resize();
  }

  /** Boxes of the names that are seen, px from the map's corner; none overlaps another. */
  labels() {
    const { width, height } = this._view;
    return [...this._layers.labels(this._view), ...this._moving].filter(
      ({ x, y }) => x >= 0 && y >= 0 && x <= width && y <= height,
    );
  }

  /**
   * What a click at a place would find.
   * @param {number} x  px from the map's corner
   * @param {number} y
   * @param {number} [within]  px
   * @returns {import("./hit.js").Hit|null}
   */
  at(x, y, within = POINTER_PX) {
    return this._scene.palette && pick(this._view, this._scene, x, y, within);
  }

  /**
   * Where something is on the screen now, px from the map's corner; null if it has no place.
   * @param {string} kind
   * @param {string} id
   * @returns {[number, number]|null}
   */
  placeOf(kind, id) {
    const box = kind === "vehicle" ? null : this._scene.boundsOf(kind, id);
    const mover = kind === "vehicle" ? this._scene.motion.movers.get(id) : null;
    if (mover) return [this._view.px(mover.x), this._view.py(mover.y)];
    return box && [this._view.px((box[0] + box[2]) / 2), this._view.py((box[1] + box[3]) / 2)];
  }

  _resize() {
    const { clientWidth: width, clientHeight: height } = this._root;
    if (!width || !height) return;
    const ratio = devicePixelRatio;
    this._canvas.width = Math.round(width * ratio);
    this._canvas.height = Math.round(height * ratio);
    this._controls.resize();
    this._camera.resize(width, height, this._scene.network.bounds, this._controls.margin());
    // A canvas of a new size is empty; without this the page would flicker.
    this._frame();
  }

  /** Another part of the map is covered: all of it that was in view stays so, and names keep clear. */
  _covered() {
    this._layers.outdate();
    if (this._camera.isFitted) this.fit();
    else this._draw();
  }

  /** A move that may glide. @param {(camera: Camera) => void} move */
  _move(move) {
    move(this._camera);
    this._draw();
  }

  /** A change of the view by a gesture. @param {(view: import("./plane/view.js").View) => void} change */
  _change(change) {
    this._move((camera) => camera.change(change));
  }

  _draw() {
    if (this._request === 0) this._request = requestAnimationFrame(() => this._frame());
  }

  _frame() {
    cancelAnimationFrame(this._request);
    clearTimeout(this._timer);
    this._request = 0;
    const { _scene: scene, _view: view, _context: context } = this;
    if (!scene.palette || view.width < 2) return;
    const now = performance.now();
    this._camera.advance(now);
    scene.motion.advance(now);
    scene.group(view);
    scene.covered = this._controls.covered();
    const ratio = this._canvas.width / view.width;
    const isExact = this._layers.refresh(view, scene, ratio, this._camera.isMoving(now), now);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this._layers.draw(context, view, scene.palette.land);
    paintVehicles(context, view, scene);
    this._moving = placeMoving(view, scene, this._layers.taken(view), this._sides);
    drawLabels(context, this._moving, scene.palette.halo);
    this._controls.setScale(view.scale);
    this._follow();
    this._next(isExact);
  }

  /** Ask for the next frame when it will show something else. */
  _next(isExact) {
    if (this._camera.isFlying) {
      this._draw();
    } else if (!isExact) {
      this._timer = setTimeout(() => this._draw(), SETTLED_MS);
    } else if (this._scene.motion.isMoving) {
      const wait = (1000 * STEP_PX) / Math.max(this._scene.motion.speed * this._view.scale, 1e-6);
      // A frame comes at the next refresh of the screen after the wait.
      this._timer = setTimeout(() => this._draw(), Math.max(STEP_MS[0], Math.min(STEP_MS[1], wait)) - 8);
    }
  }

  _click(x, y, isTouch) {
    const hit = this._under(x, y, isTouch ? FINGER_PX : POINTER_PX);
    if (!hit) this._onSelect(null, null);
    else if (hit.kind === "cluster") this._open(hit.group);
    else if (hit.kind !== "depot") this._onSelect(hit.kind, hit.id);
  }

  /** What a click means: of vehicles on each other the one after the selected one. */
  _under(x, y, within) {
    const hit = this.at(x, y, within);
    const { selection } = this._scene;
    if (hit?.kind !== "vehicle" || selection?.kind !== "vehicle" || selection.id !== hit.id) return hit;
    const other = pick(this._view, this._scene, x, y, 0, hit.id);
    return other?.kind === "vehicle" || other?.kind === "cluster" ? other : hit;
  }

  /** Part a cluster by zooming in; one that no zoom parts gives its vehicles in turn. */
  _open({ members }) {
    const [xs, ys] = [members.map(({ x }) => x), members.map(({ y }) => y)];
    const bounds = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
    if (Math.max(bounds[2] - bounds[0], bounds[3] - bounds[1]) < ONE_PLACE_M) {
      const { selection } = this._scene;
      const last = selection?.kind === "vehicle" ? selection.id : "";
      this._onSelect("vehicle", (members.find(({ id }) => id > last) ?? members[0]).id);
      return;
    }
    const goal = this._view.fitted(/** @type {any} */ (bounds), Math.min(this._view.width, this._view.height) / 4);
    goal.scale = goal.clamped(Math.max(goal.scale, BUTTON_ZOOM * this._view.scale));
    this._move((camera) => camera.fly(goal));
  }

  /** @param {[number, number]|null} pointer */
  _hover(pointer) {
    this._pointer = pointer;
    const hit = pointer && this.at(...pointer);
    if (hit && hit.kind !== "depot") this._canvas.dataset.over = hit.kind;
    else delete this._canvas.dataset.over;
    this._controls.setTooltip(hit && describe(hit, this._scene, this._units), ...(pointer ?? []));
  }

  /** What lies under a pointer that rests is another thing when the map moves. */
  _follow() {
    const { x, y, scale } = this._view;
    const key = `${x} ${y} ${scale}`;
    if (key !== this._hovered && this._pointer) this._hover(this._pointer);
    this._hovered = key;
  }

  /** Say in words what is shown, not too often for those who listen. */
  _describe(now) {
    if (now - this._summedAt < SUMMARY_MS) return;
    this._summedAt = now === Infinity ? this._summedAt : now;
    this._canvas.setAttribute("aria-label", summary(this._scene));
  }
}
