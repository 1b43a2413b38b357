/** Colours of the map: the CSS custom properties of map.css, read once for each theme. */

const NAMES = [
  "land", "street-edge", "street", "street-far", "ink", "ink-soft", "halo", "panel", "panel-edge",
  "stable", "turbulent", "unknown", "platoon", "platoon-fill", "selected", "ok", "warn", "bad", "idle",
];

/** How many colours vehicles have. */
export const VEHICLE_COLOURS = 12;

/** Least contrast of a text, by WCAG AA. */
const TEXT_CONTRAST = 4.5;
const STEP = 0.05;

/**
 * @typedef {object} Palette
 * @property {string[]} vehicles  colours of vehicles
 * @property {string[]} names  colours of their names: the same, as far towards the ink as they are read easily
 * @property {string} font  family
 * @property {boolean} isDark
 */

/** Colours in force on an element. @param {HTMLElement} element  with the class `city-map` @returns {Palette & Record<string, any>} */
export function readPalette(element) {
  const style = getComputedStyle(element);
  const read = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
  const vehicles = Array.from({ length: VEHICLE_COLOURS }, (_, i) => read(`--vehicle-${i}`));
  const colours = Object.fromEntries(
    NAMES.map((name) => [name.replace(/-(\w)/g, (_, letter) => letter.toUpperCase()), read(`--map-${name}`)]),
  );
  const isDark = element.dataset.theme === "dark";
  const names = vehicles.map((colour) => readable(colour, colours.halo, colours.ink));
  return { ...colours, vehicles, names, font: style.fontFamily, isDark };
}

/** A colour mixed with as much ink as a text of it needs on a ground; all as #rrggbb. */
function readable(colour, ground, ink) {
  const [from, to] = [channels(colour), channels(ink)];
  let mixed = from;
  for (let share = STEP; contrast(mixed, channels(ground)) < TEXT_CONTRAST && share <= 1; share += STEP) {
    mixed = from.map((value, i) => Math.round(value + share * (to[i] - value)));
  }
  return `#${mixed.map((value) => value.toString(16).padStart(2, "0")).join("")}`;
}

/** Contrast of two colours, 1 to 21, by WCAG 2. */
export function contrast(one, other) {
  const [dark, light] = [luminance(one), luminance(other)].sort((a, b) => a - b);
  return (light + 0.05) / (dark + 0.05);
}

function luminance(rgb) {
  const [r, g, b] = rgb.map((value) => (value <= 10 ? value / 3294.6 : ((value / 255 + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

/** @param {string} colour #rrggbb @returns {number[]} */
export function channels(colour) { return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16)); }

/** Have map.css in the document, whether its page links it or not. @returns {Promise<void>} settled once it is there */
export function loadStyles() {
  const address = new URL("../map.css", import.meta.url).href;
  const there = [.../** @type {NodeListOf<HTMLLinkElement>} */ (document.querySelectorAll("link[rel=stylesheet]"))].find((link) => link.href === address);
  if (there?.sheet) return Promise.resolve();
  const link = there ?? document.createElement("link");
  return new Promise((resolve) => {
    link.addEventListener("load", () => resolve(), { once: true });
    link.addEventListener("error", () => resolve(), { once: true });
    if (there) return;
    link.rel = "stylesheet";
    link.href = address;
    document.head.append(link);
  });
}
