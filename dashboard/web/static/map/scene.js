/**
 * What the map shows: the network, the rows, the selection, and what follows from them.
 *
 * @module
 */

import { chainsOf } from "./plane/chains.js";
import { clusters, middleOf } from "./clusters.js";
import { Motion } from "./motion.js";
import { Network } from "./plane/network.js";
import { relate, stopsOf } from "./relation.js";
import { platoonRoads } from "./paint/routes.js";
import { styleFor, VEHICLE_RADIUS } from "./paint/vehicles.js";

const TABLES = ["vehicles", "roads", "rsus", "orders"];
/** Least distance of two vehicles that are shown singly, in radii of their sign. */
const APART = { dot: 1.5, arrow: 1.5, disc: 1.7 };
/** Rows' fields that a moving vehicle changes and that only its own sign shows. */
const EMPTY = { bounds: [0, 0, 1, 1], roads: [], depots: [] };

export class Scene {
  /** @param {boolean} reducedMotion */
  constructor(reducedMotion) {
    this.setNetwork(EMPTY);
    this.tables = /** @type {any} */ (Object.fromEntries(TABLES.map((name) => [name, new Map()])));
    this.motion = new Motion(reducedMotion);
    /** @type {{kind: string, id: string}|null} */
    this.selection = null;
    /** @type {import("./relation.js").Relation|null} */
    this.relation = null;
    /** @type {ReturnType<typeof stopsOf>} */
    this.stops = [];
    /** @type {Set<number>} */
    this.bands = new Set();
    /** @type {any} */
    this.palette = null;
    /** @type {import("./motion.js").Mover[]} vehicles with a sign of their own */
    this.singles = [];
    /** @type {import("./clusters.js").Cluster[]} */
    this.groups = [];
    /** @type {import("./paint/vehicles.js").Style} */
    this.style = "dot";
    this._grouped = 0;
  }

  /** @param {object} data  answer of /api/network */
  setNetwork(data) {
    this.network = new Network(data);
    this.chains = chainsOf(this.network);
  }

  /**
   * Take over rows.
   *
   * @param {any} tables
   * @param {any} changed  sets of ids by table; null: all
   * @param {number} now  ms
   * @returns {boolean} whether more than vehicles' places changed
   */
  setMoment(tables, changed, now) {
    for (const name of TABLES) if (tables[name]) this.tables[name] = tables[name];
    const isNew = (/** @type {string} */ name) => !changed || Boolean(changed[name]?.size);
    if (!isNew("vehicles") && !isNew("roads") && !isNew("rsus") && !isNew("orders")) return false;
    const before = this._fingerprint();
    if (isNew("vehicles")) this.motion.update(this.tables.vehicles, changed && (changed.vehicles ?? new Set()), now);
    this._grouped = 0;
    this._relate();
    this.bands = platoonRoads(this.tables, this.network);
    return isNew("roads") || isNew("rsus") || isNew("orders") || before !== this._fingerprint();
  }

  /**
   * @param {string|null} kind
   * @param {string|null} id
   */
  select(kind, id) {
    this.selection = kind && id != null ? { kind, id } : null;
    this._grouped = 0;
    this._relate();
  }

  _relate() {
    const { selection, tables, network } = this;
    this.relation = selection && relate(tables, network, selection.kind, selection.id);
    const route = this.relation?.route;
    this.stops = route == null ? [] : stopsOf(tables.orders, route);
  }

  /** What of the vehicles is drawn with the roads: routes and bands. */
  _fingerprint() {
    const parts = [[...this.bands].join()];
    const few = this.tables.vehicles.size <= 40;
    for (const [id, row] of this.tables.vehicles) {
      if (few || id === this.relation?.route) parts.push(id, row.at, row.route?.join(" "));
    }
    parts.push([...(this.relation?.roads ?? [])].join());
    return parts.join("|");
  }

  /**
   * Have vehicles in clusters where their signs would lie on each other.
   *
   * @param {import("./plane/view.js").View} view
   */
  group(view) {
    if (this._grouped === view.scale) return;
    this._grouped = view.scale;
    const all = [...this.motion.movers.values()];
    this.style = styleFor(view.scale, all.length);
    const isKept = (mover) => this.relation?.vehicles.has(mover.id);
    const free = all.filter((mover) => !isKept(mover));
    this.groups = clusters(free, view.scale, APART[this.style] * VEHICLE_RADIUS[this.style]);
    const grouped = new Set(this.groups.flatMap((group) => group.members));
    this.singles = all.filter((mover) => !grouped.has(mover));
  }

  /**
   * Where clusters are on the screen, px.
   *
   * @param {import("./plane/view.js").View} view
   */
  circles(view) {
    return this.groups.map((group) => {
      const [x, y] = middleOf(group);
      return { group, x: view.px(x), y: view.py(y), radius: group.radius };
    });
  }

  /**
   * The box around what is named, m; null if it has no place.
   *
   * @param {string} kind
   * @param {string} id
   * @returns {[number, number, number, number]|null}
   */
  boundsOf(kind, id) {
    if (kind === "road") {
      const road = this.network.index.get(id);
      if (road === undefined) return null;
      const xs = this.network.roads[road].shape.filter((_, i) => i % 2 === 0);
      const ys = this.network.roads[road].shape.filter((_, i) => i % 2 === 1);
      return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
    }
    const row = this.tables[`${kind}s`]?.get(id);
    return row?.x == null ? null : [row.x, row.y, row.x, row.y];
  }
}
