/** Small charts as SVG: lines with intervals, bars in signed parts, strips of flags. */

import { s } from "./dom.js";

const LEFT = 40;
const RIGHT = 6;
const TOP = 8;
const BOTTOM = 18;
/** Half the width of an interval that has no neighbour. */
const ALONE_PX = 3;

/** Round values that span a range. @param {number} low @param {number} high @param {number} [wanted] about how many @returns {number[]} */
export function ticks(low, high, wanted = 3) {
  if (!(high > low)) return [low];
  const rough = (high - low) / wanted;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= rough) ?? rough;
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + step * 1e-9; n += 1) found.push(Number((n * step).toPrecision(12)));
  return found;
}

/** Texts of round values: as many digits as tell neighbours apart. @param {number[]} values evenly spaced */
export function tickTexts(values) {
  const step = values.length > 1 ? values[1] - values[0] : Math.abs(values[0] ?? 0) || 1;
  const digits = Math.min(12, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  const figure = new Intl.NumberFormat("en-GB", { minimumFractionDigits: digits, maximumFractionDigits: digits });
  return values.map((value) => (value === 0 ? "0" : figure.format(value).replace("-", "−")));
}

/** Times of the clock that span a range, ms. */
export function timeTicks(from, until, wanted = 4) {
  const minute = 60_000;
  const steps = [1, 2, 5, 10, 15, 30, 60, 120, 180, 360, 720, 1440, 2880, 10080, 20160, 43200].map((n) => n * minute);
  const step = steps.find((n) => (until - from) / n <= wanted) ?? steps[steps.length - 1];
  const found = [];
  for (let t = Math.ceil(from / step) * step; t <= until; t += step) found.push(t);
  return found;
}

const finite = (value) => typeof value === "number" && Number.isFinite(value);

/**
 * A line over time. Gaps are where values are null.
 * @param {{label: string, t: number[], values: (number|null)[], low?: (number|null)[], high?: (number|null)[],
 *   threshold?: number|null, from: number, until: number, width: number, height?: number,
 *   show: (value: number) => string, time: (ms: number) => string}} options
 */
export function lineChart(options) {
  const { t, values, low = [], high = [], threshold = null, from, until, width, height = 92, show, time } = options;
  const known = [...values, ...low, ...high, threshold].filter(finite);
  const top = known.length ? Math.max(...known) : 1;
  const floor = Math.min(0, ...known);
  const y0 = floor;
  const y1 = top > floor ? top + (top - floor) * 0.06 : floor + 1;
  const x = (ms) => round(LEFT + ((ms - from) / Math.max(1, until - from)) * (width - LEFT - RIGHT));
  const y = (value) => round(height - BOTTOM - ((value - y0) / (y1 - y0)) * (height - BOTTOM - TOP));
  const last = values.filter(finite).at(-1);
  const summary = last === undefined ? `${options.label}: no values` : `${options.label}: last ${show(last)}, from ${show(Math.min(...values.filter(finite)))} to ${show(Math.max(...values.filter(finite)))}`;
  return frame(width, height, summary, [
    axes({ width, height, x, y, values: ticks(y0, y1), times: timeTicks(from, until, width / 80), time }),
    s("path.interval", { d: band(t, low, high, x, y) }),
    finite(threshold) ? s("path.threshold", { d: `M${LEFT} ${y(threshold)}H${width - RIGHT}` }) : null,
    s("path.line", { d: line(t, values, x, y) }),
    // A point alone between gaps has no line.
    values.map((value, i) => (finite(value) && !finite(values[i - 1]) && !finite(values[i + 1])
      ? s("circle.point", { cx: x(t[i]), cy: y(value), r: 3 }) : null)),
  ]);
}

function line(t, values, x, y) {
  let path = "";
  let drawing = false;
  values.forEach((value, i) => {
    if (finite(value)) path += `${drawing ? "L" : "M"}${x(t[i])} ${y(value)}`;
    drawing = finite(value);
  });
  return path;
}

function band(t, low, high, x, y) {
  let path = "";
  let run = [];
  const close = () => {
    if (run.length === 1) {
      const [i] = run;
      path += `M${x(t[i]) - ALONE_PX} ${y(high[i])}h${2 * ALONE_PX}V${y(low[i])}h${-2 * ALONE_PX}Z`;
    } else if (run.length) {
      path += run.map((i, n) => `${n ? "L" : "M"}${x(t[i])} ${y(high[i])}`).join("");
      path += [...run].reverse().map((i) => `L${x(t[i])} ${y(low[i])}`).join("") + "Z";
    }
    run = [];
  };
  t.forEach((_ms, i) => (finite(low[i]) && finite(high[i]) ? run.push(i) : close()));
  close();
  return path;
}

function axes({ width, height, x, y, values, times, time }) {
  const texts = tickTexts(values);
  return s("g.axes", {},
    values.map((value, i) => [
      s("path", { d: `M${LEFT} ${y(value)}H${width - RIGHT}` }),
      s("text", { x: LEFT - 4, y: y(value) + 3.5, "text-anchor": "end" }, texts[i]),
    ]),
    times.map((ms) => {
      const edge = x(ms) > width - 22 ? "end" : x(ms) < LEFT + 14 ? "start" : "middle";
      return s("text", { x: x(ms), y: height - 4, "text-anchor": edge }, time(ms));
    }));
}

/**
 * Stacked bars over time: what saves rises, what costs falls below the line.
 * @param {{label: string, rows: {t: number, parts: Object<string, number>}[], step: number, from: number, until: number,
 *   width: number, height?: number, show: (value: number) => string, time: (ms: number) => string}} options `parts` by class name
 */
export function barChart(options) {
  const { rows, step, from, until, width, height = 120, show, time } = options;
  const sums = rows.map(({ parts }) => Object.values(parts).reduce(([up, down], value) => (value > 0 ? [up + value, down] : [up, down + value]), [0, 0]));
  const y0 = Math.min(0, ...sums.map(([, down]) => down));
  const y1 = Math.max(y0 < 0 ? 0 : 1e-3, ...sums.map(([up]) => up)) * 1.05;
  const x = (ms) => round(LEFT + ((ms - from) / Math.max(1, until - from)) * (width - LEFT - RIGHT));
  const y = (value) => round(height - BOTTOM - ((value - y0) / (y1 - y0 || 1)) * (height - BOTTOM - TOP));
  const total = sums.reduce((sum, [up, down]) => sum + up + down, 0);
  const bars = rows.map(({ t, parts }) => {
    let [up, down] = [0, 0];
    const [left, right] = [Math.max(LEFT, x(t) + 0.5), Math.min(width - RIGHT, x(t + step) - 0.5)];
    return s("g", {}, s("title", {}, `${time(t)}: ${show(Object.values(parts).reduce((a, b) => a + b, 0))}`),
      Object.entries(parts).map(([name, value]) => {
        const begin = value > 0 ? up : down;
        if (value > 0) up += value;
        else down += value;
        const [high, low] = [Math.max(begin, begin + value), Math.min(begin, begin + value)];
        return s(`rect.${name}`, { x: left, y: y(high), width: Math.max(0.5, right - left), height: Math.max(0, y(low) - y(high)) });
      }));
  });
  return frame(width, height, `${options.label}: ${rows.length} bars, ${show(total)} in all`, [
    axes({ width, height, x, y, values: ticks(y0, y1), times: timeTicks(from, until, width / 70), time }),
    bars,
    s("path.zero", { d: `M${LEFT} ${y(0)}H${width - RIGHT}` }),
  ]);
}

/**
 * A strip of flags over time.
 * @param {{label: string, t: number[], flags: (string|null)[], from: number, until: number, width: number}} options
 */
export function flagStrip({ label, t, flags, from, until, width }) {
  const height = 12;
  const x = (ms) => round(LEFT + ((ms - from) / Math.max(1, until - from)) * (width - LEFT - RIGHT));
  const runs = [];
  flags.forEach((flag, i) => {
    const end = t[i + 1] ?? until;
    const known = flag ?? "unknown";
    const before = runs.at(-1);
    if (before?.flag === known) before.end = end;
    else runs.push({ flag: known, begin: t[i], end });
  });
  const parts = { stable: 0, turbulent: 0, unknown: 0 };
  for (const run of runs) parts[run.flag] += run.end - run.begin;
  const all = Math.max(1, Object.values(parts).reduce((a, b) => a + b, 0));
  const words = Object.entries(parts).map(([flag, ms]) => `${flag} ${Math.round((100 * ms) / all)} %`).join(", ");
  // Heights differ too: colours alone would not tell.
  const heights = { stable: 10, turbulent: 10, unknown: 3 };
  return frame(width, height, `${label}: ${words}`, runs.map((run) => s(`rect.flag-${run.flag}`, {
    x: x(run.begin), y: 11 - heights[run.flag], width: Math.max(0.5, x(run.end) - x(run.begin)), height: heights[run.flag],
  })));
}

function frame(width, height, label, children) {
  return s("svg.chart", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label, width, height }, children);
}

function round(value) { return Math.round(value * 10) / 10; }
