/** Which rows of a table are shown, and in which order. Pure but for its caches. */

const natural = new Intl.Collator("en", { numeric: true, sensitivity: "base" });

/** Orders and filters the rows of one table. */
export class RowOrder {
  /** @param {any[]} columns @param {(row: any) => number} trouble */
  constructor(columns, trouble) {
    this.columns = columns;
    this.trouble = trouble;
    /** @type {{key: string, down: boolean}|null} */
    this.sort = null;
    this.filter = "";
    this.level = "";
    /** @type {string[]} */
    this.ids = [];
    /** @type {Map<string, number>} */
    this._places = new Map();
    /** @type {Map<string, string>} */
    this._texts = new Map();
  }

  /**
   * Brings `ids` up to date.
   * @param {Map<string, any>} rows
   * @param {Set<string>|null} changed null: all
   * @param {boolean} keep leaves rows in their places while none comes or goes
   */
  update(rows, changed, keep = false) {
    if (changed) for (const id of changed) this._texts.delete(id);
    else this._texts.clear();
    const same = rows.size === this._places.size && (!changed || [...changed].every((id) => this._places.has(id) && rows.has(id)))
      && (changed !== null || [...rows.keys()].every((id) => this._places.has(id)));
    if (!same) {
      const names = [...rows.keys()].sort(natural.compare);
      this._places = new Map(names.map((id, place) => [id, place]));
    } else if (keep) return;
    this.ids = this._ordered(this._filtered(rows), rows);
  }

  _filtered(rows) {
    const wanted = this.filter.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const found = [];
    for (const [id, row] of rows) {
      if (this.level && !(this.level === "trouble" ? row.level === "bad" || row.level === "warn" : row.level === this.level)) continue;
      if (wanted.length) {
        const text = this._text(id, row);
        if (!wanted.every((word) => text.includes(word))) continue;
      }
      found.push(id);
    }
    return found;
  }

  _text(id, row) {
    let text = this._texts.get(id);
    if (text === undefined) {
      text = `${id} ${this.columns.map((column) => column.text(row, id)).join(" ")}`.toLowerCase();
      this._texts.set(id, text);
    }
    return text;
  }

  _ordered(ids, rows) {
    const place = this._places;
    const column = this.sort && this.columns.find(({ key }) => key === this.sort?.key);
    if (!column) {
      const rank = new Map(ids.map((id) => [id, this.trouble(rows.get(id))]));
      return ids.sort((a, b) => rank.get(a) - rank.get(b) || place.get(a) - place.get(b));
    }
    if (column.key === "id" && !column.value) return ids.sort((a, b) => (place.get(a) - place.get(b)) * (this.sort?.down ? -1 : 1));
    const sign = this.sort?.down ? -1 : 1;
    const key = new Map(ids.map((id) => [id, column.value ? column.value(rows.get(id), id) : column.text(rows.get(id), id).toLowerCase()]));
    return ids.sort((a, b) => compare(key.get(a), key.get(b), sign) || place.get(a) - place.get(b));
  }
}

/** What is unknown comes last in either direction. */
function compare(a, b, sign) {
  const [noA, noB] = [a === null || a === undefined || a === "–", b === null || b === undefined || b === "–"];
  if (noA || noB) return Number(noA) - Number(noB);
  if (typeof a === "number") return (a - b) * sign;
  return a < b ? -sign : a > b ? sign : 0;
}
