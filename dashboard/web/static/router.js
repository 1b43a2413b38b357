/** The address says what is selected (`#van/ID`), which table is open (`?tab=`) and which moment (`?t=`). */

/** @typedef {{kind: string, id: string}} Selection */

/** Kinds of subjects: their table, and their name in addresses. */
export const KINDS = {
  vehicle: { table: "vehicles", hash: "van", noun: "Vehicle" },
  road: { table: "roads", hash: "road", noun: "Road" },
  rsu: { table: "rsus", hash: "rsu", noun: "Roadside unit" },
  order: { table: "orders", hash: "order", noun: "Order" },
  cycle: { table: "cycles", hash: "cycle", noun: "Cycle" },
  alarm: { table: "alarms", hash: "alarm", noun: "Alarm" },
};
const BY_HASH = new Map(Object.entries(KINDS).map(([kind, { hash }]) => [hash, kind]));
BY_HASH.set("vehicle", "vehicle");

/** "#van/van-150" @param {Selection|null} selection */
export function hashOf(selection) {
  if (!selection) return "";
  // Slashes and colons are legal in a fragment and are easier to read as they are.
  const id = encodeURIComponent(selection.id).replaceAll("%2F", "/").replaceAll("%3A", ":");
  return `#${KINDS[selection.kind].hash}/${id}`;
}

/** The selection of a fragment or of a subject such as "rsu/12"; null if it names none. @param {string} text @returns {Selection|null} */
export function parseSubject(text) {
  const match = /^#?([a-z]+)\/(.+)$/s.exec(text);
  const kind = match && BY_HASH.get(match[1]);
  if (!match || !kind) return null;
  try {
    return { kind, id: text.startsWith("#") ? decodeURIComponent(match[2]) : match[2] };
  } catch {
    return null;
  }
}

/** Reads and writes the address. */
export class Router {
  /** @param {() => void} onChange called when the reader goes back, forward or edits the address */
  constructor(onChange) {
    addEventListener("hashchange", onChange);
    addEventListener("popstate", onChange);
  }

  /** @returns {{selection: Selection|null, tab: string|null, t: number|null}} */
  read() {
    const query = new URLSearchParams(location.search);
    const t = Number(query.get("t") ?? NaN);
    // The 3D view links back by ?select=van/ID.
    const selection = parseSubject(location.hash) ?? parseSubject(query.get("select") ?? "");
    return { selection, tab: query.get("tab"), t: Number.isFinite(t) && query.has("t") ? t : null };
  }

  /** @param {{selection: Selection|null, tab: string, t: number|null}} state @param {boolean} push adds a step to go back to */
  write({ selection, tab, t }, push) {
    const query = new URLSearchParams();
    if (tab !== "vehicles") query.set("tab", tab);
    if (t !== null) query.set("t", String(Math.round(t)));
    const search = query.size ? `?${query}` : "";
    const url = `${location.pathname}${search}${hashOf(selection)}`;
    if (url === `${location.pathname}${location.search}${location.hash}`) return;
    history[push ? "pushState" : "replaceState"](null, "", url);
  }
}
