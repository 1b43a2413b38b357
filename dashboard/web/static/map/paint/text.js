/** Widths of texts, and their drawing with a border that sets them off from the map. */

const BORDER_PX = 3;

/** @type {Map<string, number>} */
const widths = new Map();
const ruler = document.createElement("canvas").getContext("2d");

/** Width of a text, px. @param {string} text @param {string} font  as in CSS */
export function widthOfText(text, font) {
  const key = `${font}|${text}`;
  let width = widths.get(key);
  if (width === undefined) {
    if (widths.size > 20000) widths.clear();
    ruler.font = font;
    widths.set(key, (width = ruler.measureText(text).width));
  }
  return width;
}

/**
 * A text with a place on the map.
 * @typedef {import("../plane/placement.js").Box & {kind: string, id: string, text: string, font: string,
 *   size: number, colour: string, plate?: boolean, side?: number}} Label  plate: with a ground of its own, as it lies on lines
 */

/**
 * A label without a place yet; its box has the text's size.
 * @param {string} kind
 * @param {string} id
 * @param {string} text
 * @param {any} palette
 * @param {{size?: number, weight?: number, colour?: string}} [look]
 * @returns {Label}
 */
export function makeLabel(kind, id, text, palette, { size = 11, weight = 500, colour = palette.ink } = {}) {
  const font = `${weight} ${size}px ${palette.font}`;
  const width = widthOfText(text, font) + BORDER_PX;
  return { kind, id, text, font, size, colour, x: 0, y: 0, width, height: size + BORDER_PX, angle: 0 };
}

/** @param {CanvasRenderingContext2D} context @param {Iterable<Label>} labels @param {string} border  colour */
export function drawLabels(context, labels, border) {
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  context.lineJoin = "round";
  context.lineWidth = BORDER_PX;
  context.strokeStyle = border;
  for (const label of labels) {
    context.save();
    context.translate(label.x, label.y);
    if (label.angle) context.rotate(label.angle);
    context.font = label.font;
    if (label.plate) {
      context.fillStyle = border;
      context.fillRect(-label.width / 2, -label.height / 2, label.width, label.height);
    }
    context.fillStyle = label.colour;
    context.strokeText(label.text, 0, 0.35 * label.size);
    context.fillText(label.text, 0, 0.35 * label.size);
    context.restore();
  }
}
