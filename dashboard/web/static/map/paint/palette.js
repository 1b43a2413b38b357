/**
 * Colours of the map: the CSS custom properties of map.css, read once for each theme.
 *
 * @module
 */

const NAMES = [
  "land", "street-edge", "street", "street-far", "ink", "ink-soft", "halo", "panel", "panel-edge",
  "stable", "turbulent", "unknown", "platoon", "platoon-fill", "selected", "ok", "warn", "bad", "idle",
];

/** How many colours vehicles have. */
export const VEHICLE_COLOURS = 12;

/**
 * @typedef {object} Palette
 * @property {string[]} vehicles  colours of vehicles
 * @property {string} font  family
 * @property {boolean} isDark
 */

/**
 * Colours in force on an element.
 *
 * @param {HTMLElement} element  with the class `city-map`
 * @returns {Palette & Record<string, string>}
 */
export function readPalette(element) {
  const style = getComputedStyle(element);
  const read = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
  const vehicles = Array.from({ length: VEHICLE_COLOURS }, (_, i) => read(`--vehicle-${i}`));
  const colours = Object.fromEntries(
    NAMES.map((name) => [name.replace(/-(\w)/g, (_, letter) => letter.toUpperCase()), read(`--map-${name}`)]),
  );
  const isDark = element.dataset.theme === "dark";
  return { ...colours, vehicles, font: style.fontFamily, isDark };
}

/**
 * Have map.css in the document, whether its page links it or not.
 *
 * @returns {Promise<void>} settled once it is there
 */
export function loadStyles() {
  const address = new URL("../map.css", import.meta.url).href;
  const there = [...document.querySelectorAll("link[rel=stylesheet]")].find((link) => link.href === address);
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
