/** A cycle's card: its result, what its solvers said, who was left out and why. */

import { h } from "../dom.js";
import { words } from "../format.js";
import { chip } from "../marks.js";
import { energyParts } from "../energy_parts.js";
import { facts, link, longTable, section, sentences, tile } from "./parts.js";

const BACKENDS = { simulated: "simulated", "noise-model": "simulated with a device's noise", hardware: "hardware" };

/** @param {string} id @param {any} row @param {any} detail @param {import("./parts.js").CardContext} ctx */
export function cycleCard(id, row, detail, ctx) {
  const { f } = ctx;
  return [
    h("div.lead", {}, chip(row.level, row.why ? `${words(row.status)}: ${row.why}` : words(row.status))),
    h("div.tiles", {},
      tile("To save", f.kwh(row.saved_kwh), f.share(row.saved_share)),
      tile("In platoons", f.km(row.platoon_km)),
      tile("Took", `${f.number(row.wall_s, 1)}\u00a0s`),
      tile("Unserved", f.number(detail?.unserved?.length ?? row.unserved))),
    facts([
      ["Time", f.moment(row.t)],
      ["Solver", row.solver],
      ["Plans", f.number(row.plans)],
      ["Variables", f.number(row.variables)],
    ]),
    detail?.energy ? section("Energy of its plans", energyParts(detail.energy, f, true)) : null,
    detail?.unserved?.length ? section("Not served", longTable(["Order", "Why"], detail.unserved.map((one) => [link("order", one.stop), words(one.reason)]), "Not served")) : null,
    detail ? section("Solvers", detail.solvers?.length ? longTable(["Solver", "Result", "#Cost kWh", "#Time s"], detail.solvers.map((one) => [
      [one.solver, circuit(one, f)], words(one.status) + (one.reason ? `: ${words(one.reason)}` : ""), f.number(one.objective_kwh, 3), f.number(one.wall_s, 2),
    ]), "Solvers", 12) : h("p.muted", {}, row.solver ? "No block solver was needed." : "No solver ran.")) : h("p.muted", {}, "Loading…"),
    detail ? inWords(detail.explain) : null,
  ];
}

/** Where a solver's circuit ran, why not on the device, and what its samples were; nothing without one. */
function circuit(run, f) {
  const parts = [
    run.qubits && `${run.qubits} qubits`,
    run.backend && `on ${[run.backend, BACKENDS[run.backend_kind]].filter(Boolean).join(", ")}`,
    run.two_qubit_depth && `two-qubit depth ${run.two_qubit_depth}`,
    run.p_feasible_raw != null && `valid samples ${f.share(run.p_feasible_raw, 2)}, repaired ${f.share(run.p_feasible_repaired)}`,
    run.p_optimal_raw != null && `the best one in ${f.share(run.p_optimal_raw, 2)}`,
    run.fallback && `instead of the device: ${run.fallback}`,
  ].filter(Boolean);
  return parts.length ? h("div.muted", {}, parts.join(" · ")) : null;
}

/** Why its vehicles go where they go, and which platoons it does not have. */
function inWords(told) {
  if (!told) return section("In words", h("p.muted", {}, "No words are stored of it."));
  return [
    section("In words", sentences([...told.summary, ...told.notes], "")),
    told.orders.length ? section("Orders put into tours", longTable(["Order", "Why"], told.orders.map((one) => [
      link("order", one.id), one.lines.map((line) => h("div", {}, line)),
    ]), "Orders put into tours", 6)) : null,
    told.vehicles.length ? section("Its vehicles", longTable(["Vehicle", "Why"], told.vehicles.map((one) => [
      link("vehicle", one.id), one.lines.map((line) => h("div", {}, line)),
    ]), "Its vehicles", 6)) : null,
    told.refused.length ? section("Platoons that it does not have", longTable(["Vehicles, roads and why"], told.refused.map((line) => [line]), "Platoons that it does not have", 6)) : null,
  ];
}
