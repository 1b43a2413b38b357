/** Where vehicles are drawn between two messages: on their way from the last place to the next. */

const MIN_DURATION_MS = 200;
const MAX_DURATION_MS = 2500;
/** A vehicle that is farther from its last place than this, in m, is there at once. */
const MAX_STEP_M = 250;

/**
 * A vehicle with a place.
 * @typedef {object} Mover
 * @property {string} id
 * @property {any} row  its row by the contract
 * @property {number} x  where it is drawn, m
 * @property {number} y
 * @property {number} heading  degrees clockwise from north
 * @property {any} step  its present step, null when it stands
 */

export class Motion {
  /** @param {boolean} reduced  vehicles are at their last place at once */
  constructor(reduced) {
    this._reduced = reduced;
    /** @type {Map<string, Mover>} */
    this.movers = new Map();
    /** @type {Set<Mover>} those on their way */
    this._moving = new Set();
    this._last = -Infinity;
    this._interval = 1000;
  }

  /**
   * Take over what vehicles' rows say.
   * @param {Map<string, any>} vehicles  all rows by id
   * @param {Set<string>|null} changed  ids that may have changed; null: all, and at once
   * @param {number} now  ms
   */
  update(vehicles, changed, now) {
    const since = now - this._last;
    if (changed?.size) this._last = now;
    // Steps last as long as messages are apart, so that a vehicle moves evenly.
    if (since < 2 * MAX_DURATION_MS && changed) this._interval += 0.3 * (since - this._interval);
    const duration = Math.min(MAX_DURATION_MS, Math.max(MIN_DURATION_MS, this._interval));
    for (const id of changed ?? vehicles.keys()) {
      this._set(id, vehicles.get(id), changed ? duration : 0, now);
    }
    if (changed) return;
    for (const id of [...this.movers.keys()]) if (!vehicles.has(id)) this._set(id, undefined, 0, now);
  }

  _set(id, row, duration, now) {
    const mover = this.movers.get(id);
    if (row?.x == null || row.y == null) {
      this._moving.delete(mover);
      this.movers.delete(id);
      return;
    }
    const heading = row.heading ?? mover?.heading ?? 0;
    if (!mover) {
      this.movers.set(id, { id, row, x: row.x, y: row.y, heading, step: null });
      return;
    }
    mover.row = row;
    const goal = mover.step ?? { x1: mover.x, y1: mover.y, turn: 0, heading: mover.heading };
    if (duration && row.x === goal.x1 && row.y === goal.y1) return;
    const far = Math.hypot(row.x - mover.x, row.y - mover.y) > MAX_STEP_M;
    if (!duration || this._reduced || far) {
      Object.assign(mover, { x: row.x, y: row.y, heading, step: null });
      this._moving.delete(mover);
      return;
    }
    const turn = ((heading - mover.heading + 540) % 360) - 180;
    mover.step = {
      x0: mover.x, y0: mover.y, x1: row.x, y1: row.y, heading: mover.heading, turn, begin: now, duration,
    };
    this._moving.add(mover);
  }

  /** Move all vehicles to where they are at a time. @param {number} now  ms */
  advance(now) {
    for (const mover of this._moving) {
      const step = mover.step;
      const part = Math.min(1, Math.max(0, (now - step.begin) / step.duration));
      mover.x = step.x0 + part * (step.x1 - step.x0);
      mover.y = step.y0 + part * (step.y1 - step.y0);
      // A turn is done in the step's first half: vehicles turn at junctions, not all the way.
      mover.heading = step.heading + Math.min(1, 2 * part) * step.turn;
      if (part === 1) {
        mover.step = null;
        this._moving.delete(mover);
      }
    }
  }

  /** Fastest vehicle, m/s; 0 if none moves. */
  get speed() {
    let most = 0;
    for (const { step } of this._moving) {
      most = Math.max(most, (1000 * Math.hypot(step.x1 - step.x0, step.y1 - step.y0)) / step.duration);
    }
    return most;
  }

  get isMoving() {
    return this._moving.size > 0;
  }
}
