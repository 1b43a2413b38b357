/** Drawing of what has a place: depots, RSUs, orders and numbered stops. */

/** From this scale on, px a metre, orders are shown that nothing is wrong with. */
const ORDERS_FROM = 0.3;
const TROUBLE = new Set(["warn", "bad"]);

/** Radii of signs, px. */
export const RADII = { depot: 8, rsu: 7, order: 5, stop: 9 };

/** Whether an order has a sign at a scale. @param {any} row @param {number} scale  px a metre */
export function showsOrder(row, scale) {
  if (row.x == null) return false;
  return scale >= ORDERS_FROM || (TROUBLE.has(row.level) && row.state !== "served");
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {any} palette
 * @param {{x: number, y: number}[]} depots
 */
export function drawDepots(context, view, palette, depots) {
  for (const depot of depots) {
    const [x, y] = [view.px(depot.x), view.py(depot.y)];
    const path = new Path2D();
    for (const [dx, dy] of [[0, -8], [8, -1], [8, 8], [-8, 8], [-8, -1]]) path.lineTo(x + dx, y + dy);
    path.closePath();
    outlined(context, path, palette.ink, palette.halo);
    context.fillStyle = palette.halo;
    context.fillRect(x - 2.5, y + 1.5, 5, 6.5);
  }
}

/**
 * A diamond each: filled where it is well, with a mark where it is not.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {any} palette
 * @param {Iterable<[string, any]>} rsus  ids and rows
 */
export function drawRsus(context, view, palette, rsus) {
  for (const [, row] of rsus) {
    if (row.x == null) continue;
    const [x, y] = [view.px(row.x), view.py(row.y)];
    if (isOutside(view, x, y)) continue;
    const trouble = TROUBLE.has(row.level);
    const radius = trouble ? 8 : view.scale < 0.12 ? 4.5 : 6;
    const path = new Path2D();
    path.moveTo(x, y - radius);
    path.lineTo(x + radius, y);
    path.lineTo(x, y + radius);
    path.lineTo(x - radius, y);
    path.closePath();
    outlined(context, path, trouble ? palette[row.level] : palette.ink, palette.halo);
    if (trouble) mark(context, row.level === "bad" ? "×" : "!", x, y, palette.halo, palette.font, 11);
    else if (row.level === "ok") dot(context, x, y, radius / 3, palette.halo);
  }
}

/**
 * A small square each, in the colour of its level; crossed out where it failed.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {any} palette
 * @param {Iterable<[string, any]>} orders  ids and rows
 */
export function drawOrders(context, view, palette, orders) {
  for (const [, row] of orders) {
    if (!showsOrder(row, view.scale)) continue;
    const [x, y] = [view.px(row.x), view.py(row.y)];
    if (isOutside(view, x, y)) continue;
    const trouble = TROUBLE.has(row.level);
    const size = trouble ? 4.5 : 3.5;
    const ended = row.state === "served" || row.state === "cancelled";
    const path = new Path2D();
    path.rect(x - size, y - size, 2 * size, 2 * size);
    outlined(context, path, ended ? palette.idle : palette.halo, palette.halo);
    context.lineWidth = 1.8;
    context.strokeStyle = trouble ? palette[row.level] : ended ? palette.idle : palette.inkSoft;
    context.stroke(path);
    if (row.state !== "failed") continue;
    const cross = new Path2D();
    for (const side of [-1, 1]) {
      cross.moveTo(x - side * size, y - size);
      cross.lineTo(x + side * size, y + size);
    }
    context.stroke(cross);
  }
}

/**
 * The stops of a selected vehicle, numbered.
 * @param {CanvasRenderingContext2D} context
 * @param {import("../plane/view.js").View} view
 * @param {any} palette
 * @param {{row: any, number: number}[]} stops
 * @param {string} colour
 */
export function drawStops(context, view, palette, stops, colour) {
  // The next stop lies on top of later ones at the same place.
  for (const { row, number } of [...stops].reverse()) {
    const [x, y] = [view.px(row.x), view.py(row.y)];
    const path = new Path2D();
    path.arc(x, y, RADII.stop, 0, 2 * Math.PI);
    outlined(context, path, palette.halo, palette.halo);
    context.lineWidth = 2.5;
    context.strokeStyle = TROUBLE.has(row.level) ? palette[row.level] : colour;
    context.stroke(path);
    mark(context, String(number), x, y, palette.ink, palette.font, 11);
  }
}

/**
 * The ring around what is selected.
 * @param {CanvasRenderingContext2D} context
 * @param {any} palette
 * @param {number} x  px
 * @param {number} y
 * @param {number} radius
 */
export function drawHalo(context, palette, x, y, radius) {
  const ring = new Path2D();
  ring.arc(x, y, radius, 0, 2 * Math.PI);
  context.strokeStyle = palette.halo;
  context.lineWidth = 6;
  context.stroke(ring);
  context.strokeStyle = palette.selected;
  context.lineWidth = 2.5;
  context.stroke(ring);
}

/** Fill a shape, with a border that sets it off from what lies under it. */
export function outlined(context, path, fill, border) {
  context.lineJoin = "round";
  context.lineWidth = 3;
  context.strokeStyle = border;
  context.stroke(path);
  context.fillStyle = fill;
  context.fill(path);
}

function dot(context, x, y, radius, colour) {
  context.fillStyle = colour;
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fill();
}

/** A character or two in the middle of a sign. */
export function mark(context, text, x, y, colour, font, size) {
  context.font = `700 ${size}px ${font}`;
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  context.fillStyle = colour;
  context.fillText(text, x, y + 0.36 * size);
}

export function isOutside(view, x, y) {
  return x < -20 || y < -20 || x > view.width + 20 || y > view.height + 20;
}
