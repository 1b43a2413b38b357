/** Prints what is shown: all rows of the open table, what is folded up in the card, light colours. */

import { byId, setText } from "./dom.js";

/**
 * Gets the page ready for paper before it is printed, and back.
 * @param {{tabs: import("./tabs.js").Tabs, map: import("./map_panel.js").MapPanel}} page
 */
export function makePrintable({ tabs, map }) {
  let opened = /** @type {Element[]|null} */ (null);
  const begin = () => {
    if (opened) return;
    opened = [...document.querySelectorAll("#card-body details:not([open])")];
    for (const fold of opened) fold.setAttribute("open", "");
    setText(byId("print-title"), tabs.inWords());
    tabs.print(true);
    map.print(true);
  };
  const end = () => {
    for (const fold of opened ?? []) fold.removeAttribute("open");
    opened = null;
    tabs.print(false);
    map.print(false);
  };
  addEventListener("beforeprint", begin);
  addEventListener("afterprint", end);
  // A browser that only looks at the page as on paper tells it this way.
  matchMedia("print").addEventListener("change", ({ matches }) => (matches ? begin() : end()));
}
