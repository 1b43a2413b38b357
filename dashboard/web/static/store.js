/** What is shown at one moment: tables of rows, kept up by deltas (docs/page.md). */

export const TABLES = /** @type {const} */ (["vehicles", "roads", "rsus", "orders", "cycles", "alarms"]);
const FIELDS = ["status", "energy", "next_cycle", "paused", "dispatcher_heard"];

/** @typedef {Object<string, any>} Row */
/** @typedef {Record<typeof TABLES[number], Map<string, Row>>} Tables */
/** @typedef {Object<string, Set<string>>|null} Changed ids by table; null is everything */

/** One moment of the city. */
export class Store {
  constructor() {
    this.tables = /** @type {Tables} */ (Object.fromEntries(TABLES.map((name) => [name, new Map()])));
    /** @type {number|null} */
    this.t = null;
    this.live = false;
    /** @type {any} */
    this.status = null;
    /** @type {any} */
    this.energy = null;
    /** @type {number|null} */
    this.next_cycle = null;
    this.paused = false;
    this.dispatcher_heard = false;
  }

  /** Replaces everything. @param {any} moment @returns {Changed} */
  setMoment(moment) {
    this.t = moment.t;
    this.live = Boolean(moment.live);
    for (const name of TABLES) this.tables[name] = new Map(Object.entries(moment[name] ?? {}));
    for (const field of FIELDS) this[field] = moment[field] ?? null;
    this.paused = Boolean(moment.paused);
    return null;
  }

  /** Takes a delta in; answers which rows it changed. @param {any} delta @returns {Changed} */
  apply(delta) {
    this.t = delta.t;
    /** @type {Object<string, Set<string>>} */
    const changed = Object.fromEntries(TABLES.map((name) => [name, new Set()]));
    for (const name of TABLES) {
      const table = this.tables[name];
      for (const id of delta.del?.[name] ?? []) {
        if (table.delete(id)) changed[name].add(id);
      }
      for (const [id, fields] of Object.entries(delta.set?.[name] ?? {})) {
        const row = table.get(id);
        if (row) Object.assign(row, fields);
        else table.set(id, /** @type {Row} */ (fields));
        changed[name].add(id);
      }
    }
    for (const field of FIELDS) if (field in delta) this[field] = delta[field];
    return changed;
  }
}
