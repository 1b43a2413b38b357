/** The time bar: live, or any moment that is kept, by hand or played. */

import { getJson } from "./api.js";
import { byId, setText } from "./dom.js";
import { readMoment } from "./moments.js";

const SPANS = { hour: 3_600_000, day: 86_400_000, week: 604_800_000, all: Infinity };
const RANGE_MS = 60_000;
const FRAME_MS = 500;
const DRAG_MS = 120;
/** Moments are written to the second: so far beyond the ends of what is kept they are meant. */
const SLACK_MS = 1000;
/** A last cycle that is farther from the moment shown than so many of its periods, and at least so long, is told. */
const PERIODS = 5;
const APART_MS = 600_000;

/** That what is shown is of long before the moment, as no cycle ran near it; null: one did. @param {any} moment @param {import("./format.js").Format} f */
function apart(moment, f) {
  const begun = Object.values(moment.cycles ?? {}).map((row) => row.t).sort((a, b) => b - a);
  const period = begun.length > 1 ? (begun[0] - begun[Math.min(begun.length - 1, 10)]) / Math.min(begun.length - 1, 10) : 0;
  if (!begun.length || moment.t - begun[0] <= Math.max(APART_MS, PERIODS * period)) return null;
  return `No cycle is stored near this moment: plans and roads are those of ${f.moment(begun[0])} ${f.zone(begun[0])}, the last one before it.`;
}

/** Says which moment is shown, and fetches those of the past. */
export class TimeBar {
  /**
   * @param {import("./format.js").Format} format
   * @param {{history: boolean, live: boolean}} config
   * @param {{onMoment: (moment: any) => void, onLive: () => void, onFailure: (text: string|null) => void, onStay: () => void}} handlers
   */
  constructor(format, config, handlers) {
    this.format = format;
    this.config = config;
    this.handlers = handlers;
    /** @type {number|null} the past moment shown; null is live */
    this.t = null;
    this.range = { first: /** @type {number|null} */ (null), last: /** @type {number|null} */ (null) };
    this.parts = Object.fromEntries(["live", "play", "rate", "span", "slider", "moment", "back", "forth", "badge"].map((name) => [name, byId(`time-${name}`)]));
    byId("timebar").hidden = !config.history && config.live;
    this.parts.live.hidden = !config.live;
    this._listen();
    this._draw();
    if (config.history) setInterval(() => this.refreshRange(), RANGE_MS);
  }

  _listen() {
    const { live, play, slider, moment, back, forth, span } = this.parts;
    live.addEventListener("click", () => this.goLive());
    play.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
    slider.addEventListener("input", () => {
      const t = Number(slider.value);
      this.dragged = t;
      this.pause();
      this._label(t);
      clearTimeout(this.drag);
      this.drag = setTimeout(() => {
        this.dragged = null;
        this.go(t);
      }, DRAG_MS);
    });
    moment.addEventListener("change", () => {
      if (!moment.value.trim()) return this._draw();
      const read = readMoment(moment.value, this.format, { now: Date.now(), shown: this._here() });
      if ("problem" in read) this._refuse(read.problem);
      else this.go(read.t, read.note);
    });
    moment.addEventListener("input", () => moment.setCustomValidity(""));
    back.addEventListener("click", () => this.go(this._here() - 60_000));
    forth.addEventListener("click", () => this.go(this._here() + 60_000));
    span.addEventListener("change", () => this._draw());
  }

  /** Asks which past is kept. */
  async refreshRange() {
    try {
      this.range = await getJson("api/past");
      this.failed = false;
    } catch (error) {
      this.failed = true;
      this.handlers.onFailure(`The stored past cannot be read: ${error.message}`);
    }
    this._draw();
  }

  _here() { return this.t ?? this.range.last ?? Date.now(); }

  /** Leaves what is shown, and says why. @param {string} problem */
  _refuse(problem) {
    const { moment } = this.parts;
    this.pause();
    const shown = this.t === null ? "the present" : this.format.moment(this.t);
    this.handlers.onFailure(`${problem} Shown is still ${shown}.`);
    this.handlers.onStay();
    if (document.activeElement !== moment) return;
    moment.setCustomValidity(problem);
    moment.reportValidity();
  }

  /** Why nothing can be shown of a moment, in words; null: it is kept. @param {number} t @returns {Promise<string|null>} */
  async _notKept(t) {
    const isOut = () => t < this.range.first - SLACK_MS || t > this.range.last + SLACK_MS;
    if (this.range.first === null || isOut()) await this.refreshRange();
    const { format: f, range: { first, last } } = this;
    if (first === null || last === null) return this.failed ? null : "No past is stored yet.";
    if (!isOut()) return null;
    const why = t > Date.now() ? `${f.moment(t)} ${f.zone(t)} is yet to come` : `Nothing is kept of ${f.moment(t)} ${f.zone(t)}`;
    return `${why}: the past is kept from ${f.moment(first)} to ${f.moment(last)} ${f.zone(last)}.`;
  }

  /** Shows a past moment, or says why it cannot. @param {number} t @param {string|null} [note] what to say of it */
  async go(t, note = null) {
    const problem = await this._notKept(t);
    if (problem !== null) return this._refuse(problem);
    const { first, last } = this.range;
    if (first === null || last === null) return;
    this.wanted = Math.max(first, Math.min(last, t));
    if (this.asking) return;
    this.asking = true;
    try {
      // A slow server gets the newest wish only.
      for (let asked = null; asked !== this.wanted && this.wanted !== null;) {
        asked = this.wanted;
        const moment = await getJson(`api/at?t=${Math.round(asked)}`);
        if (this.wanted === null) break;
        this.t = asked;
        this.handlers.onFailure(note ?? apart(moment, this.format));
        this._draw();
        this.handlers.onMoment(moment);
      }
    } catch (error) {
      this.pause();
      this.handlers.onFailure(`The moment could not be shown: ${error.message}`);
    } finally {
      this.asking = false;
    }
  }

  goLive() {
    if (!this.config.live) return;
    this.pause();
    this.wanted = null;
    this.t = null;
    this.handlers.onFailure(null);
    this._draw();
    this.handlers.onLive();
  }

  play() {
    if (this.t === null) return;
    let before = performance.now();
    this.playing = setInterval(() => {
      const now = performance.now();
      // Time runs on while a moment is fetched, so that the rate holds.
      this.at = (this.at ?? this._here()) + (now - before) * Number(this.parts.rate.value);
      before = now;
      if (this.at >= (this.range.last ?? 0)) return this.config.live ? this.goLive() : this.pause();
      this.go(this.at);
    }, FRAME_MS);
    this.at = this.t;
    this._draw();
  }

  pause() {
    clearInterval(this.playing);
    this.playing = undefined;
    this.at = undefined;
    this._draw();
  }

  _draw() {
    const { slider, play, live, rate, span, moment, back, forth } = this.parts;
    const { first, last } = this.range;
    const none = first === null || last === null;
    for (const part of [slider, rate, span, moment, back, forth]) part.disabled = none;
    play.disabled = none || this.t === null;
    live.setAttribute("aria-pressed", String(this.t === null));
    play.setAttribute("aria-pressed", String(Boolean(this.playing)));
    play.setAttribute("aria-label", this.playing ? "Pause" : "Play");
    play.querySelector("use").setAttribute("href", `static/icons.svg#${this.playing ? "pause" : "play"}`);
    document.documentElement.dataset.time = this.t === null ? "live" : "past";
    if (none) return this._label(null);
    const here = this.dragged ?? this._here();
    const width = SPANS[span.value];
    const end = here > last - width ? last : Math.min(last, here + width / 2);
    slider.min = String(Math.floor(Math.max(first, end - width)));
    slider.max = String(Math.ceil(end));
    slider.value = String(Math.round(here));
    if (document.activeElement !== moment) {
      // "now" moves on: a moment beside it would be old at once.
      moment.value = this.t === null ? "" : this.format.localInput(here);
      moment.setCustomValidity("");
      moment.title = `Kept from ${this.format.localInput(first)} to ${this.format.localInput(last)} ${this.format.zone(last)}; write a moment in this time zone, as ${this.format.localInput(last)}, “yesterday 14:00” or 14:00 of the day shown`;
    }
    this._label(this.t);
  }

  _label(t) {
    const { badge, slider } = this.parts;
    const past = t === null ? null : this.format.moment(t);
    const none = this.range.first === null;
    setText(badge, past ?? (none && this.config.history ? "nothing stored yet" : this.config.live ? "now" : "nothing stored"));
    slider.setAttribute("aria-valuetext", past ?? "live");
  }
}
