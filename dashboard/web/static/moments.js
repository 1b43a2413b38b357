/** Moments as a reader writes them: taken as written, or refused in words. */

const DAY_MS = 86_400_000;
const HOUR_MS = 3_600_000;
const FORM = /^(?:(\d{4}-\d\d-\d\d)(?:[T ]\s*|$)|(today|yesterday)\b\s*)?(?:(\d\d?):(\d\d)(?::(\d\d))?)?\s*(Z|UTC|[+-]\d\d:?\d\d)?$/i;

/**
 * The moment that a text names: "2026-11-23 14:02", "yesterday 14:02", "14:02" of the day shown, in the page's zone; with a zone
 * of its own ("Z", "+01:00") in that.
 * @param {string} text
 * @param {import("./format.js").Format} f
 * @param {{now: number, shown: number}} at ms: the present, and the moment shown
 * @returns {{t: number, note: string|null}|{problem: string}} the problem or note in words
 */
export function readMoment(text, f, { now, shown }) {
  const [, date, word, hour, minute, second = "00", zone] = FORM.exec(text.trim().replace(/\s+/g, " ")) ?? [];
  if (hour === undefined) return { problem: `“${text.trim()}” is no moment. Write one as ${f.localInput(shown)}, “yesterday 14:00” or 14:00; it is taken in the page's time zone, ${f.zone(shown)}.` };
  const day = date ?? f.isoDay(word?.toLowerCase() === "yesterday" ? yesterday(f, now) : word ? now : shown);
  const wanted = `${day} ${hour.padStart(2, "0")}:${minute}:${second}`;
  const naive = Date.parse(`${wanted.replace(" ", "T")}Z`);
  if (Number.isNaN(naive) || new Date(naive).toISOString().slice(0, 19).replace("T", " ") !== wanted) return { problem: `There is no ${wanted}.` };
  if (zone) return { t: naive - offsetOf(zone), note: null };
  const t = f.fromLocalInput(wanted);
  if (t === null) return { problem: `There is no ${wanted} in the page's time zone: its clocks were put forward then.` };
  const [earlier, later] = [t - HOUR_MS, t + HOUR_MS].map((other) => f.localInput(other) === wanted);
  if (!earlier && !later) return { t, note: null };
  const first = earlier ? t - HOUR_MS : t;
  return { t: first, note: `${wanted} came twice, as clocks were put back: the first one is shown, ${f.zone(first)}. Add a zone, as ${wanted} UTC, for another.` };
}

/** A moment of the day before, however long that was. */
function yesterday(f, now) {
  const noon = f.fromLocalInput(`${f.isoDay(now)} 12:00`) ?? now;
  return noon - DAY_MS;
}

/** ms east of UTC. @param {string} zone */
function offsetOf(zone) {
  const [, sign, hours, minutes] = /^([+-])(\d\d):?(\d\d)$/.exec(zone) ?? [];
  return sign ? (sign === "-" ? -1 : 1) * (Number(hours) * HOUR_MS + Number(minutes) * 60_000) : 0;
}
