/** What the map shows: the network, the rows, the selection, and what follows from them. */

import { chainsOf } from "./plane/chains.js";
import { clusters, middleOf } from "./clusters.js";
import { Motion } from "./motion.js";
import { Network } from "./plane/network.js";
import { relate, stopsOf } from "./relation.js";
import { RADII } from "./paint/markers.js";
import { platoonRoads } from "./paint/routes.js";
import { styleFor, VEHICLE_RADIUS } from "./paint/vehicles.js";

/** Directions from a depot in which a cluster is moved off it, the best first. */
const ASIDE = [[0, -1], [0, 1], [-1, 0], [1, 0], [-0.7, -0.7], [0.7, -0.7], [-0.7, 0.7], [0.7, 0.7]];
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
    /** @type {import("./plane/placement.js").Box[]} what lies over the map, px from its corner */
    this.covered = [];
  }

  /** @param {object} data  answer of /api/network */
  setNetwork(data) {
    this.network = new Network(data);
    this.chains = chainsOf(this.network);
  }

  /**
   * Take over rows.
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

  /** @param {string|null} kind @param {string|null} id */
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

  /** Have vehicles in clusters where their signs would lie on each other. @param {import("./plane/view.js").View} view */
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
   * Where clusters are on the screen, px: in the middle of their vehicles, or beside a depot that they would cover.
   * @param {import("./plane/view.js").View} view
   */
  circles(view) {
    const circles = this.groups.map((group) => {
      const [x, y] = middleOf(group);
      return { group, x: view.px(x), y: view.py(y), radius: group.radius };
    });
    for (const depot of this.network.depots) this._clear(circles, view.px(depot.x), view.py(depot.y), view);
    return circles;
  }

  /** Moves a cluster off a depot's sign to where it lies on no other sign, if there is such a place. */
  _clear(circles, x, y, view) {
    const covering = circles.find((circle) => Math.hypot(circle.x - x, circle.y - y) < circle.radius + RADII.depot);
    if (!covering) return;
    const away = covering.radius + 1.5 * RADII.depot;
    const around = VEHICLE_RADIUS[this.style];
    const isFree = (px, py) => circles.every((other) => other === covering || Math.hypot(other.x - px, other.y - py) >= other.radius + covering.radius)
      && this.singles.every((mover) => Math.hypot(view.px(mover.x) - px, view.py(mover.y) - py) >= around + covering.radius);
    for (const [dx, dy] of ASIDE) {
      if (!isFree(x + dx * away, y + dy * away)) continue;
      [covering.x, covering.y] = [x + dx * away, y + dy * away];
      return;
    }
  }

  /**
   * The box around what is named, m; null if it has no place.
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
