/** What the map's signs and lines mean, drawn as they are. */

import { drawDepots, drawOrders, drawRsus } from "./markers.js";
import { PATTERNS, strokeBand } from "./roads.js";
import { View } from "../plane/view.js";
import { drawVehicles } from "./vehicles.js";

const ROW_PX = 24;
const TEXT_X = 46;
const COLUMN_PX = 262;

/** @type {[string, (context: CanvasRenderingContext2D, y: number, palette: any) => void][]} */
const ENTRIES = [
  ["stable: platoons may drive", flagged("stable")],
  ["turbulent", flagged("turbulent")],
  ["unknown: no platoons", flagged("unknown")],
  ["platoon ahead, gate open", band],
  ["vehicle, place reported", vehicle({ source: "reported", state: "driving" })],
  ["vehicle, place by plan", vehicle({ source: "planned", state: "driving" })],
  ["vehicle silent, place heard last", vehicle({ source: "last", state: "silent", level: "bad" })],
  ["stopped", vehicle({ source: "reported", state: "stopped" })],
  ["waiting", vehicle({ source: "reported", state: "waiting" })],
  ["roadside unit", signed(drawRsus, { level: "ok" })],
  ["roadside unit with trouble", signed(drawRsus, { level: "bad" })],
  ["order", signed(drawOrders, { level: "ok", state: "planned" })],
  ["order late or not in a plan", signed(drawOrders, { level: "warn", state: "planned" })],
  ["order that failed", signed(drawOrders, { level: "bad", state: "failed" })],
  ["order that has ended", signed(drawOrders, { level: "ok", state: "served" })],
  ["depot", (context, y, palette) => drawDepots(context, atPixels(), palette, [{ x: 18, y: -y }])],
];

/** @returns {{width: number, height: number}} px */
export function legendSize(columns = 1) {
  return { width: columns * COLUMN_PX, height: Math.ceil(ENTRIES.length / columns) * ROW_PX };
}

/** The legend in words. */
export function legendText() {
  return `Legend. Roads: stable solid, turbulent dashed, unknown dotted, platoons a double line beside. Vehicles: filled where reported,
    hollow by plan, with a question mark where silent, with a bar when stopped, two strokes when waiting. Diamonds: roadside units. Squares: orders, orange where late or not in a plan, crossed out where failed, grey where ended.
    House: depot.`;
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {number} x  its left upper corner, px
 * @param {number} y
 * @param {any} palette
 * @param {number} [columns]
 */
export function drawLegend(context, x, y, palette, columns = 1) {
  const rows = Math.ceil(ENTRIES.length / columns);
  ENTRIES.forEach(([text, draw], index) => {
    context.save();
    context.translate(x + Math.floor(index / rows) * COLUMN_PX, y);
    const middle = (index % rows) * ROW_PX + ROW_PX / 2;
    draw(context, middle, palette);
    context.font = `12px ${palette.font}`;
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.fillStyle = palette.ink;
    context.fillText(text, TEXT_X, middle);
    context.restore();
  });
}

function flagged(flag) {
  return (context, y, palette) => {
    const width = 5;
    context.strokeStyle = palette[flag];
    context.lineWidth = width;
    context.lineCap = flag === "unknown" ? "round" : "butt";
    context.setLineDash(PATTERNS[flag].map((part) => part * width));
    const path = new Path2D();
    path.moveTo(2, y);
    path.lineTo(36, y);
    context.stroke(path);
    context.setLineDash([]);
  };
}

function band(context, y, palette) {
  const path = new Path2D();
  path.moveTo(2, y);
  path.lineTo(36, y);
  strokeBand(context, palette, path, 8);
}

function vehicle(row) {
  return (context, y, palette) =>
    drawVehicles(context, atPixels(), palette, [{ id: "", row, x: 18, y: -y - (row.state === "driving" ? 0 : 2), heading: 60, step: null }], "arrow");
}

function signed(draw, row) {
  return (context, y, palette) => draw(context, atPixels(), palette, [["", { ...row, x: 18, y: -y }]]);
}

/** A view in which a metre is a pixel, with the corner in the middle of nothing. */
function atPixels() {
  const view = new View();
  view.width = view.height = 2000;
  view.x = 1000;
  view.y = -1000;
  return view;
}
