/** A sum of energy as figures and as a bar of its parts. */

import { h, s } from "./dom.js";

const PARTS = [["distance", "Distance"], ["drag", "Drag"], ["acceleration", "Acceleration"]];

/** The parts of what a sum or row saved, kWh. @param {any} sum */
export function partsOf(sum) {
  return Object.fromEntries(PARTS.map(([name]) => [name, sum[`${name}_kwh`] ?? 0]));
}

/** @param {any} sum an EnergySum @param {import("./format.js").Format} f @param {boolean} planned it is that of plans, which may not be driven yet */
export function energyParts(sum, f, planned = false) {
  const parts = partsOf(sum);
  return h("div.energy", {},
    h("p.headline", {}, h("strong.num", {}, f.kwh(Math.abs(sum.saved_kwh ?? 0))), sum.saved_kwh < 0 ? (planned ? " to be used beyond " : " more than ") : planned ? " to be saved of " : " saved of ",
      h("span.num", {}, f.kwh(sum.baseline_kwh)), " ", h("span.num.muted", {}, f.share(sum.saved_share))),
    bar(parts),
    h("dl.parts", {}, PARTS.map(([name, label]) => h("div", {}, h("dt", {}, h(`span.dot.${name}`, { "aria-hidden": "true" }), label), h("dd.num", {}, f.kwh(parts[name], true))))),
    h("dl.parts", {}, [
      [planned ? "To drive" : "Driven", f.km(sum.km)],
      ["In platoons", f.km(sum.platoon_km)],
      ["CO₂", f.mass(sum.co2_kg)],
      ["Money", f.money(sum.money)],
    ].filter(([, value]) => value !== "–").map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd.num", {}, value)))),
    h("p.muted", {}, `Against ${sum.baseline ?? "no baseline yet"}`));
}

/** The parts side by side, each as long as its size; what costs is hatched by its class. */
function bar(parts) {
  const all = Object.values(parts).reduce((sum, value) => sum + Math.abs(value), 0);
  let x = 0;
  return s("svg.split", { viewBox: "0 0 100 6", preserveAspectRatio: "none", "aria-hidden": "true" }, PARTS.map(([name]) => {
    const width = all ? (100 * Math.abs(parts[name])) / all : 0;
    const rect = s(`rect.${name}${parts[name] < 0 ? ".costs" : ""}`, { x, y: 0, width, height: 6 });
    x += width;
    return rect;
  }));
}
