/** What belongs to a selection: it is drawn in full, all else is dimmed. */

/**
 * @typedef {object} Relation
 * @property {Set<string>} vehicles
 * @property {Set<string>} roads
 * @property {Set<string>} rsus
 * @property {Set<string>} orders
 * @property {string|null} route  vehicle whose route is drawn
 */

/** States of orders whose stop lies ahead. */
const AHEAD = new Set(["open", "planned", "under_way"]);

/**
 * @param {any} tables  rows by the contract
 * @param {import("./plane/network.js").Network} network
 * @param {string} kind  vehicle, road, rsu or order
 * @param {string} id
 * @returns {Relation|null}  null: there is nothing of this name, nothing is to be dimmed for it
 */
export function relate(tables, network, kind, id) {
  if (!tables[`${kind}s`]?.has(id) && !(kind === "road" && network.index.has(id))) return null;
  /** @type {Relation} */
  const found = { vehicles: new Set(), roads: new Set(), rsus: new Set(), orders: new Set(), route: null };
  if (kind === "road") {
    found.roads.add(id);
    const rsu = tables.roads.get(id)?.rsu;
    if (rsu) found.rsus.add(rsu);
  } else if (kind === "rsu") {
    found.rsus.add(id);
    for (const road of tables.rsus.get(id)?.segments ?? []) found.roads.add(road);
  } else if (kind === "order") {
    found.orders.add(id);
    found.route = tables.orders.get(id)?.vehicle ?? null;
  } else {
    found.route = id;
    for (const partner of tables.vehicles.get(id)?.with ?? []) found.vehicles.add(partner);
    for (const stop of stopsOf(tables.orders, id)) found.orders.add(stop.id);
  }
  if (kind === "road" || kind === "rsu") {
    for (const [vehicle, row] of tables.vehicles) if (found.roads.has(row.road)) found.vehicles.add(vehicle);
  }
  if (found.route !== null) {
    found.vehicles.add(found.route);
    for (const [road] of tables.vehicles.get(found.route)?.route ?? []) {
      if (network.roads[road]) found.roads.add(network.roads[road].id);
    }
  }
  return found;
}

/**
 * A vehicle's stops that lie ahead and have a place, in the order of their arrival.
 * @param {Map<string, any>} orders
 * @param {string} vehicle
 * @returns {{id: string, row: any, number: number}[]}  numbered from 1
 */
export function stopsOf(orders, vehicle) {
  const stops = [];
  for (const [id, row] of orders) {
    if (row.vehicle === vehicle && row.x != null && AHEAD.has(row.state)) stops.push({ id, row });
  }
  const due = ({ row }) => row.eta ?? row.latest ?? Infinity;
  stops.sort((a, b) => due(a) - due(b) || (a.id < b.id ? -1 : 1));
  return stops.map((stop, index) => ({ ...stop, number: index + 1 }));
}
