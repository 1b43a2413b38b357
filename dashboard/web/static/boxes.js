/** Whether pictures of cameras have boxes around the vehicles that their unit recognises; kept in the browser. */

import { subjectUrl } from "./api.js";
import { h } from "./dom.js";

const KEY = "slipstream.boxes";

/** Whether they have. */
export function hasBoxes() { return localStorage.getItem(KEY) !== "off"; }

/** A switch for it; `[data-boxes]` tells it from others. */
export function boxSwitch() {
  return h("label.switch", {}, h("input", { type: "checkbox", "data-boxes": true, checked: hasBoxes() }), " Boxes around the vehicles that it recognises");
}

/** Takes over what was switched. @param {boolean} on */
export function setBoxes(on) {
  localStorage.setItem(KEY, on ? "on" : "off");
  for (const box of document.querySelectorAll("input[data-boxes]")) /** @type {HTMLInputElement} */ (box).checked = on;
}

/** The address of a unit's latest picture. @param {string} rsu */
export function pictureUrl(rsu) { return subjectUrl("rsus", rsu, null, "/still") + (hasBoxes() ? "" : "?boxes=false"); }
