// Runs before anything is drawn, so that the page does not flash in the other theme; hence no module.
(() => {
  const KEY = "slipstream.theme";
  const system = matchMedia("(prefers-color-scheme: dark)");
  const apply = () => {
    const chosen = localStorage.getItem(KEY) ?? "system";
    document.documentElement.dataset.themeChoice = chosen;
    document.documentElement.dataset.theme = chosen === "system" ? (system.matches ? "dark" : "light") : chosen;
    dispatchEvent(new Event("themechange"));
  };
  system.addEventListener("change", apply);
  addEventListener("storage", apply);
  addEventListener("choosetheme", (event) => {
    localStorage.setItem(KEY, /** @type {CustomEvent} */ (event).detail);
    apply();
  });
  apply();
})();
