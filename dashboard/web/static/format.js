/** Figures in the reader's units, clock times in the settings' time zone. */

const MISSING = "–";
const NBSP = "\u00a0";
const SECOND_MS = 1000;
const MINUTE_MS = 60_000;
const HALF_DAY_MS = 43_200_000;
const KM_PER_MILE = 1.609344;
const M_PER_FOOT = 0.3048;

/** Formats values of one configuration. Every method answers "–" for null. */
export class Format {
  /** @param {{units?: string, time_zone?: string|null, currency?: string}} config */
  constructor(config) {
    this.imperial = config.units === "imperial";
    this.currency = config.currency ?? "EUR";
    const timeZone = config.time_zone ?? undefined;
    const clock = { hour: "2-digit", minute: "2-digit", hourCycle: "h23", timeZone };
    const make = (options) => new Intl.DateTimeFormat("en-GB", options);
    this._clock = make({ ...clock, second: "2-digit" });
    this._minute = make(clock);
    this._day = make({ day: "numeric", month: "short", timeZone });
    this._date = make({ weekday: "short", day: "numeric", month: "short", year: "numeric", timeZone });
    this._zone = make({ timeZoneName: "short", timeZone });
    this._iso = new Intl.DateTimeFormat("en-CA", { year: "numeric", month: "2-digit", day: "2-digit", timeZone });
    this._parts = make({ ...clock, year: "numeric", month: "2-digit", day: "2-digit", second: "2-digit", timeZone });
    this._digits = [0, 1, 2, 3].map(
      (n) => new Intl.NumberFormat("en-GB", { minimumFractionDigits: n, maximumFractionDigits: n }),
    );
  }

  /** "14:02:11", the nearest second @param {number|null} ms */
  clock(ms) { return missing(ms) ? MISSING : this._clock.format(nearest(ms, SECOND_MS)); }

  /** "14:02", the nearest minute, and the day before it half a day or more from `now`. @param {number|null} ms */
  time(ms, now = Date.now()) {
    if (missing(ms)) return MISSING;
    const whole = nearest(ms, MINUTE_MS);
    const minute = this._minute.format(whole);
    return this._near(whole, now) ? minute : `${this._shortDay(whole)}, ${minute}`;
  }

  /** When something began: to the second while it is recent, so that it does not lie ahead. @param {number|null} ms */
  since(ms, now = Date.now()) { return !missing(ms) && Math.abs(now - ms) < 90 * SECOND_MS ? this.clock(ms) : this.time(ms, now); }

  /** The same in a narrow column: the day alone, half a day or more from `now`. @param {number|null} ms */
  brief(ms, now = Date.now()) {
    return missing(ms) || this._near(nearest(ms, MINUTE_MS), now) ? this.time(ms, now) : this._shortDay(nearest(ms, MINUTE_MS));
  }

  _shortDay(ms) { return this._day.format(ms).replace(" ", NBSP); }

  /** Whether a clock time says which day is meant. Around midnight the other day's is as clear as today's. */
  _near(ms, now) { return Math.abs(ms - now) < HALF_DAY_MS || this.isoDay(ms) === this.isoDay(now); }

  /** "Mon 23 Nov 2026, 14:02:11" @param {number|null} ms */
  moment(ms) { return missing(ms) ? MISSING : `${this.date(nearest(ms, SECOND_MS))}, ${this.clock(ms)}`; }

  /** "Mon 23 Nov 2026" @param {number|null} ms */
  date(ms) { return missing(ms) ? MISSING : this._date.format(ms).replace(",", ""); }

  /** "23 Nov" @param {number|null} ms */
  day(ms) { return missing(ms) ? MISSING : this._day.format(ms); }

  /** "2026-11-23" @param {number} ms */
  isoDay(ms) { return this._iso.format(ms); }

  /** "CET" @param {number} ms */
  zone(ms) { return this._zone.formatToParts(ms).find((part) => part.type === "timeZoneName")?.value ?? ""; }

  /** "2026-11-23 14:02:11", which `fromLocalInput` reads. @param {number} ms */
  localInput(ms) {
    const part = Object.fromEntries(this._parts.formatToParts(nearest(ms, SECOND_MS)).map(({ type, value }) => [type, value]));
    return `${part.year}-${part.month}-${part.day} ${part.hour}:${part.minute}:${part.second}`;
  }

  /**
   * UTC of a moment written in the page's zone: "2026-11-23 14:02", with seconds or not; a time alone is of `day`.
   * Null if it is none.
   * @param {string} text @param {number} [day] ms
   */
  fromLocalInput(text, day = Date.now()) {
    const match = /^\s*(?:(\d{4}-\d\d-\d\d)[T ]\s*)?(\d\d?):(\d\d)(:\d\d)?\s*$/.exec(text);
    if (!match) return null;
    const [, date = this.isoDay(day), hour, minute, second = ":00"] = match;
    const wanted = `${date} ${hour.padStart(2, "0")}:${minute}${second}`;
    const naive = Date.parse(`${wanted.replace(" ", "T")}Z`);
    if (Number.isNaN(naive)) return null;
    // Twice: the first guess may lie on the other side of a change to summer time.
    let ms = naive;
    for (let i = 0; i < 2; i += 1) ms += naive - Date.parse(`${this.localInput(ms).replace(" ", "T")}Z`);
    // A date that there is not, as 30 February, and an hour that clocks leave out become another one.
    return this.localInput(ms) === wanted ? ms : null;
  }

  /** "14:02–14:30"; an open end is left out. */
  window(begin, end, now = Date.now()) { return this._window(begin, end, (ms) => this.time(ms, now)); }

  /** The same in a narrow column. */
  briefWindow(begin, end, now = Date.now()) { return this._window(begin, end, (ms) => this.brief(ms, now)); }

  _window(begin, end, show) {
    if (missing(begin) && missing(end)) return MISSING;
    if (missing(begin)) return `by ${show(end)}`;
    if (missing(end)) return `from ${show(begin)}`;
    const [first, last] = [show(begin), show(end)];
    return first === last ? first : `${first}–${last}`;
  }

  /** "4 min 10 s" @param {number|null} seconds */
  duration(seconds) {
    if (missing(seconds)) return MISSING;
    const all = Math.round(Math.abs(seconds));
    const sign = seconds < 0 && all > 0 ? "−" : "";
    const [d, hours, m, sec] = [Math.floor(all / 86400), Math.floor(all / 3600) % 24, Math.floor(all / 60) % 60, all % 60];
    const parts = [[d, "d"], [hours, "h"], [m, "min"], [sec, "s"]].filter(([n]) => n);
    if (!parts.length) return `0${NBSP}s`;
    return sign + parts.slice(0, 2).map(([n, unit]) => `${n}${NBSP}${unit}`).join(" ");
  }

  /** "+4 min" late, "−2 min" early, "on time" within half a minute. @param {number|null} seconds */
  delay(seconds) {
    if (missing(seconds)) return MISSING;
    if (Math.abs(seconds) < 30) return "on time";
    return `${seconds > 0 ? "+" : "−"}${Math.round(Math.abs(seconds) / 60)}${NBSP}min`;
  }

  /** @param {number|null} value */
  number(value, digits = 0) {
    if (missing(value)) return MISSING;
    const text = this._digits[digits].format(value);
    // Less than half of the last digit below zero is nothing.
    return /[1-9]/.test(text) ? text.replace("-", "−") : text.replace("-", "");
  }

  /** A number with as many digits as it is worth. @param {number|null} value */
  measure(value) {
    if (missing(value)) return MISSING;
    const size = Math.abs(value);
    return this.number(value, size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 || size === 0 ? 2 : 3);
  }

  /** The number of a speed in the reader's unit. @param {number} kmh */
  speedValue(kmh) { return this.imperial ? kmh / KM_PER_MILE : kmh; }

  get speedUnit() { return this.imperial ? "mph" : "km/h"; }

  speed(kmh) { return missing(kmh) ? MISSING : `${this.number(this.speedValue(kmh))}${NBSP}${this.speedUnit}`; }

  /** @param {number|null} m */
  distance(m) {
    if (missing(m)) return MISSING;
    if (Math.abs(m) >= 1000) return this.km(m / 1000);
    return this.imperial ? `${this.number(m / M_PER_FOOT)}${NBSP}ft` : `${this.number(m)}${NBSP}m`;
  }

  /** @param {number|null} km */
  km(km) {
    if (missing(km)) return MISSING;
    const value = this.imperial ? km / KM_PER_MILE : km;
    return `${this.number(value, Math.abs(value) < 100 ? 1 : 0)}${NBSP}${this.imperial ? "mi" : "km"}`;
  }

  kwh(kwh, signed = false) {
    if (missing(kwh)) return MISSING;
    const digits = Math.abs(kwh) < 0.1 && kwh !== 0 ? 3 : Math.abs(kwh) < 10 ? 2 : Math.abs(kwh) < 1000 ? 1 : 0;
    return `${signed && kwh > 0 ? "+" : ""}${this.number(kwh, digits)}${NBSP}kWh`;
  }

  share(share, digits = 1) { return missing(share) ? MISSING : `${this.number(share * 100, digits)}${NBSP}%`; }

  mass(kg) {
    if (missing(kg)) return MISSING;
    return Math.abs(kg) >= 1000 ? `${this.number(kg / 1000, 2)}${NBSP}t` : `${this.number(kg, Math.abs(kg) < 10 ? 1 : 0)}${NBSP}kg`;
  }

  money(value) {
    if (missing(value)) return MISSING;
    const sign = value < 0 ? "−" : "";
    return `${sign}${this.currency}${NBSP}${this.number(Math.abs(value), 2)}`;
  }
}

/** A moment to its nearest second or minute: one that a calculation left a hair short is not told a whole unit short. @param {number} ms @param {number} unit ms */
function nearest(ms, unit) { return Math.round(ms / unit) * unit; }

/** @param {any} value */
function missing(value) { return value === null || value === undefined || Number.isNaN(value); }

/** "under_way" as words. @param {string|null|undefined} code */
export function words(code) { return code ? String(code).replaceAll("_", " ") : MISSING; }

/** "1 van", "2 vans", "1,000 roads" @param {number} n @param {string} noun */
export function count(n, noun, plural = `${noun}s`) { return `${n.toLocaleString("en-GB")}${NBSP}${n === 1 ? noun : plural}`; }
