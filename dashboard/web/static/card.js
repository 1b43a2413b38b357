/** The card of what is selected: fetched once, kept up with its row. */

import { getJson, subjectUrl } from "./api.js";
import { alarmCard } from "./cards/alarm.js";
import { cycleCard } from "./cards/cycle.js";
import { orderCard } from "./cards/order.js";
import { roadCard } from "./cards/road.js";
import { rsuCard } from "./cards/rsu.js";
import { vehicleCard } from "./cards/vehicle.js";
import { byId, h, morph, setText } from "./dom.js";
import { KINDS } from "./router.js";

const CARDS = { vehicle: vehicleCard, road: roadCard, rsu: rsuCard, order: orderCard, cycle: cycleCard, alarm: alarmCard };
/** Kinds whose row says everything. */
const WHOLE = new Set(["alarm"]);
/** Kinds that exist without a row: a road that nobody watches. */
const ROWLESS = new Set(["road"]);
const REFRESH_MS = 3000;
/** What is stored of the last hour grows without the row changing. */
const RENEW_MS = 15_000;

/** Shows one subject at a time. */
export class CardPanel {
  /** @param {() => any} context the CardContext of now */
  constructor(context) {
    this.context = context;
    this.root = byId("card");
    this.body = byId("card-body");
    new ResizeObserver(() => this.draw()).observe(this.body);
  }

  /** @param {{kind: string, id: string}|null} selection */
  select(selection) {
    const same = selection && this.selection && selection.kind === this.selection.kind && selection.id === this.selection.id;
    this.selection = selection;
    this.root.hidden = !selection;
    if (same) return;
    this.detail = null;
    this.failure = null;
    this.asked = 0;
    // Also ends a picture's stream.
    this.body.replaceChildren();
    this.body.scrollTop = 0;
    if (selection) this.refresh(true);
  }

  /** After a change. @param {boolean} changed whether the row has changed, or the moment */
  refresh(changed) {
    const { selection } = this;
    if (!selection) return;
    const age = Date.now() - this.asked;
    const { t } = this.context();
    const due = t !== this.detailT || (t === null && age > (changed ? REFRESH_MS : RENEW_MS)) || !this.asked;
    if (due && !WHOLE.has(selection.kind)) this._ask(selection, t);
    if (changed || !this.body.childElementCount) this.draw();
  }

  async _ask(selection, t) {
    this.asked = Date.now();
    this.detailT = t;
    try {
      const detail = await getJson(subjectUrl(KINDS[selection.kind].table, selection.id, t));
      if (this.selection !== selection && (this.selection?.kind !== selection.kind || this.selection?.id !== selection.id)) return;
      this.detail = detail;
      this.failure = null;
    } catch (error) {
      if (this.selection?.id !== selection.id) return;
      this.failure = error.message;
    }
    this.draw();
  }

  /** Draws it of what is known. */
  draw() {
    const { selection } = this;
    if (!selection) return;
    const context = { ...this.context(), width: Math.max(260, this.body.clientWidth - 24) };
    const row = context.tables[KINDS[selection.kind].table].get(selection.id) ?? (this.detail && !ROWLESS.has(selection.kind) ? this.detail : null);
    const name = selection.kind === "road" ? context.roadName(selection.id) : selection.kind === "alarm" ? row?.text ?? selection.id : selection.id;
    setText(byId("card-kind"), KINDS[selection.kind].noun);
    setText(byId("card-title"), selection.kind === "alarm" ? "" : name);
    const known = row || (ROWLESS.has(selection.kind) && (this.detail || !this.failure));
    const parts = known ? CARDS[selection.kind](selection.id, row, this.detail, context)
      : [h("p.empty", {}, this.failure ?? (this.asked || WHOLE.has(selection.kind) ? "There is nothing of this name at this moment." : "Loading…"))];
    morph(this.body, h("div", {}, this.failure && known ? h("p.failure", {}, `Details could not be read: ${this.failure}`) : null, parts));
  }
}
