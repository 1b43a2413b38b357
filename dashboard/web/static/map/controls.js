/** What lies over the map: buttons, scale bar, north arrow, legend, tooltip. */

import { drawLegend, legendSize, legendText } from "./paint/legend.js";
import { scaleBar } from "./plane/scalebar.js";

const SVG = "http://www.w3.org/2000/svg";
const FIT = "M2 6V2h4M10 2h4v4M14 10v4h-4M6 14H2v-4";
/** Between what lies over the map and what keeps clear of it, px. */
const CLEAR_PX = 8;
const EDGE_PX = 32;
/** From this width on the legend has two columns, px. */
const WIDE_PX = 640;
/** Least share of the map's width or height that an open legend leaves to the roads. */
const LEFT_SHARE = 0.4;
/** From the pointer, px. */
const TOOLTIP_AWAY = 14;

/** @param {string} name @param {string} className @param {HTMLElement} parent */
function add(name, className, parent) {
  const element = document.createElement(name);
  element.className = className;
  parent.append(element);
  return element;
}

/** @param {string} box @param {[string, string][]} paths  d and fill */
function drawing(box, paths) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", box);
  svg.setAttribute("aria-hidden", "true");
  for (const [d, fill] of paths) {
    const path = document.createElementNS(SVG, "path");
    path.setAttribute("d", d);
    path.setAttribute("fill", fill);
    path.setAttribute("stroke", "currentColor");
    path.setAttribute("stroke-width", "1.6");
    svg.append(path);
  }
  return svg;
}

export class Controls {
  /**
   * @param {HTMLElement} root
   * @param {{zoomIn: () => void, zoomOut: () => void, fit: () => void, cover: () => void}} actions  cover: another part
   *   of the map is covered
   * @param {string} units  metric or imperial
   */
  constructor(root, actions, units) {
    this._root = root;
    this._units = units;
    this._buttons = add("div", "map-buttons", root);
    this._button("Zoom in", "+", actions.zoomIn);
    this._button("Zoom out", "−", actions.zoomOut);
    this._button("Show the whole map", drawing("0 0 16 16", [[FIT, "none"]]), actions.fit);
    this._north = add("div", "map-north", root);
    this._north.append(drawing("0 0 30 40", [["M15 3 L21 21 L15 17 L9 21 Z", "currentColor"],
      ["M11.5 36V26.5L18.5 36V26.5", "none"]]));
    this._scale = add("div", "map-scale", root);
    this._legend = /** @type {HTMLDetailsElement} */ (add("details", "map-legend", root));
    add("summary", "", this._legend).textContent = "Legend";
    this._swatches = /** @type {HTMLCanvasElement} */ (add("canvas", "", this._legend));
    this._swatches.setAttribute("role", "img");
    this._swatches.setAttribute("aria-label", legendText());
    this._legend.addEventListener("toggle", () => {
      this._boxes = null;
      actions.cover();
    });
    /** @type {import("./plane/placement.js").Box[]|null} */
    this._boxes = null;
    this._columns = 0;
    /** @type {any} */
    this._palette = null;
    this._ratio = 1;
    this._tooltip = add("div", "map-tooltip", root);
    this._tooltip.hidden = true;
  }

  _button(label, content, action) {
    const button = /** @type {HTMLButtonElement} */ (add("button", "", this._buttons));
    button.type = "button";
    button.title = label;
    button.setAttribute("aria-label", label);
    button.append(content);
    button.addEventListener("click", action);
  }

  /** @param {number} scale  px a metre */
  setScale(scale) {
    const { width, text } = scaleBar(scale, this._units);
    this._scale.style.width = `${Math.round(width)}px`;
    if (this._scale.textContent === text) return;
    this._scale.textContent = text;
    this._boxes = null;
  }

  /** The map has another size. */
  resize() {
    this._boxes = null;
    if (this._palette && this._columns !== this._wanted()) this._drawLegend();
  }

  _wanted() { return this._root.clientWidth >= WIDE_PX ? 2 : 1; }

  /** What of the map is covered, px from its corner. @returns {import("./plane/placement.js").Box[]} */
  covered() {
    if (this._boxes) return this._boxes;
    const frame = this._root.getBoundingClientRect();
    this._boxes = [this._buttons, this._north, this._scale, this._legend].map((element) => {
      const { left, top, width, height } = element.getBoundingClientRect();
      return { x: left - frame.left + width / 2, y: top - frame.top + height / 2, width: width + CLEAR_PX, height: height + CLEAR_PX, angle: 0 };
    });
    return this._boxes;
  }

  /**
   * Margins of the whole map at the right and below: clear of the buttons, and of the legend where it is open
   * and leaves room enough.
   * @returns {{right: number, bottom: number}} px
   */
  margin() {
    const { clientWidth: width, clientHeight: height } = this._root;
    const beside = this._buttons.offsetWidth + 10 + CLEAR_PX;
    const margin = { right: Math.max(EDGE_PX, beside), bottom: EDGE_PX };
    if (!this._legend.open) return margin;
    const right = this._legend.offsetWidth + 10 + CLEAR_PX;
    const bottom = this._legend.offsetHeight + 10 + CLEAR_PX;
    const [across, down] = [1 - right / width, 1 - bottom / height];
    if (Math.max(across, down) < LEFT_SHARE) return margin;
    return across > down ? { ...margin, right } : { ...margin, bottom };
  }

  /** @param {any} palette @param {number} ratio  device pixels a px */
  setPalette(palette, ratio) {
    [this._palette, this._ratio] = [palette, ratio];
    this._drawLegend();
  }

  _drawLegend() {
    const { _palette: palette, _ratio: ratio } = this;
    this._columns = this._wanted();
    this._boxes = null;
    const { width, height } = legendSize(this._columns);
    this._swatches.width = width * ratio;
    this._swatches.height = height * ratio;
    this._swatches.style.width = `${width}px`;
    const context = this._swatches.getContext("2d");
    context.scale(ratio, ratio);
    drawLegend(context, 0, 0, palette, this._columns);
  }

  /**
   * Show lines of text beside the pointer, or nothing.
   * @param {string[]|null} lines  the title first
   * @param {number} [x]  px
   * @param {number} [y]
   */
  setTooltip(lines, x = 0, y = 0) {
    this._tooltip.hidden = !lines;
    if (!lines) return;
    this._tooltip.replaceChildren(...lines.map((line, index) => {
      const element = document.createElement(index ? "span" : "strong");
      element.textContent = line;
      return element;
    }));
    const { offsetWidth: width, offsetHeight: height } = this._tooltip;
    const left = x + TOOLTIP_AWAY + width < this._root.clientWidth ? x + TOOLTIP_AWAY : x - TOOLTIP_AWAY - width;
    const top = y + TOOLTIP_AWAY + height < this._root.clientHeight ? y + TOOLTIP_AWAY : y - TOOLTIP_AWAY - height;
    this._tooltip.style.transform = `translate(${Math.max(2, left)}px, ${Math.max(2, top)}px)`;
  }
}
