/** Which boxes lie near a place: a grid of square cells that knows the boxes that touch each. */

export class Grid {
  /** @param {number} cell  side of a cell, in the unit of the boxes, > 0 */
  constructor(cell) {
    this._cell = cell;
    /** @type {Map<number, Map<number, number[]>>} cells by column and row: numbers of boxes */
    this._columns = new Map();
    this._count = 0;
  }

  /** Add a box; its number is how many were added before. @param {[number, number, number, number]} box  x0, y0, x1, y1 */
  add(box) {
    const number = this._count++;
    for (let column = this._at(box[0]); column <= this._at(box[2]); column++) {
      let rows = this._columns.get(column);
      if (!rows) this._columns.set(column, (rows = new Map()));
      for (let row = this._at(box[1]); row <= this._at(box[3]); row++) {
        const cell = rows.get(row);
        if (cell) cell.push(number);
        else rows.set(row, [number]);
      }
    }
  }

  /**
   * Numbers of the boxes whose cells a box touches, each once.
   * @param {[number, number, number, number]} box  x0, y0, x1, y1
   * @returns {Set<number>}
   */
  near(box) {
    const found = new Set();
    const collect = (/** @type {Map<number, number[]>} */ rows) => {
      for (const [row, cell] of within(rows, this._at(box[1]), this._at(box[3]))) {
        for (const number of cell) found.add(number);
      }
    };
    for (const [, rows] of within(this._columns, this._at(box[0]), this._at(box[2]))) collect(rows);
    return found;
  }

  _at(value) {
    return Math.floor(value / this._cell);
  }
}

/** Entries of a map whose keys lie in a range, by the shorter of both ways. */
function* within(map, first, last) {
  if (last - first < map.size) {
    for (let key = first; key <= last; key++) if (map.has(key)) yield [key, map.get(key)];
  } else {
    for (const entry of map) if (entry[0] >= first && entry[0] <= last) yield entry;
  }
}
