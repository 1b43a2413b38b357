/** The map as a picture, with legend, time and scale. */

import { placeMoving, placeStill } from "./labels.js";
import { drawLegend, legendSize } from "./paint/legend.js";
import { paintGround, paintState, paintVehicles } from "./paint/painting.js";
import { scaleBar } from "./plane/scalebar.js";
import { drawLabels } from "./paint/text.js";

const RATIO = 2;
const MAX_SIDE_PX = 8192;
const EDGE = 14;
const HEADER = 34;

/**
 * @param {import("./plane/view.js").View} view
 * @param {import("./scene.js").Scene} scene
 * @param {string} text  what stands over the picture: title, time
 * @param {string} units  metric or imperial
 * @returns {Promise<Blob>} PNG
 */
export function pictureOf(view, scene, text, units) {
  const { palette } = scene;
  const columns = Math.max(1, Math.floor((view.width - EDGE) / legendSize().width));
  const legend = legendSize(Math.min(columns, 6));
  const height = HEADER + view.height + legend.height + 2 * EDGE;
  const ratio = Math.min(RATIO, MAX_SIDE_PX / Math.max(view.width, height));
  const canvas = document.createElement("canvas");
  canvas.width = Math.round(view.width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d", { alpha: false });
  context.scale(ratio, ratio);
  context.fillStyle = palette.halo;
  context.fillRect(0, 0, view.width, height);
  context.fillStyle = palette.ink;
  context.font = `600 14px ${palette.font}`;
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.fillText(text, EDGE, HEADER / 2, view.width - 2 * EDGE);
  context.save();
  context.translate(0, HEADER);
  context.beginPath();
  context.rect(0, 0, view.width, view.height);
  context.clip();
  paintGround(context, view, scene);
  paintState(context, view, scene);
  const still = placeStill(view, scene, 0);
  drawLabels(context, still.labels, palette.halo);
  paintVehicles(context, view, scene);
  drawLabels(context, placeMoving(view, scene, still.taken, new Map()), palette.halo);
  drawScale(context, view, palette, units);
  drawNorth(context, palette);
  context.restore();
  drawLegend(context, EDGE, HEADER + view.height + EDGE, palette, Math.min(columns, 6));
  return new Promise((resolve, reject) => {
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("the browser made no picture"))), "image/png");
  });
}

function drawScale(context, view, palette, units) {
  const { width, text } = scaleBar(view.scale, units);
  const y = view.height - EDGE;
  context.fillStyle = palette.halo;
  context.fillRect(EDGE - 4, y - 20, width + 8, 26);
  context.strokeStyle = context.fillStyle = palette.ink;
  context.lineWidth = 1.5;
  context.beginPath();
  for (const [dx, dy] of [[0, -5], [0, 0], [width, 0], [width, -5]]) context.lineTo(EDGE + dx, y + dy);
  context.stroke();
  context.font = `11px ${palette.font}`;
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  context.fillText(text, EDGE + width / 2, y - 6);
}

function drawNorth(context, palette) {
  context.fillStyle = palette.ink;
  context.beginPath();
  for (const [x, y] of [[25, 12], [31, 30], [25, 26], [19, 30]]) context.lineTo(x, y);
  context.fill();
  context.font = `700 11px ${palette.font}`;
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  context.fillText("N", 25, 43);
}
