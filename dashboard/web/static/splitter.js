/** The line between tables and map, which a reader may move. */

const KEY = "slipstream.split";
const LOW = 24;
const HIGH = 70;
const STEP = 2;

/** @param {HTMLElement} bar @param {HTMLElement} main */
export function makeSplitter(bar, main) {
  const set = (percent) => {
    const value = Math.round(Math.max(LOW, Math.min(HIGH, percent)) * 10) / 10;
    main.style.setProperty("--left", `${value}%`);
    bar.setAttribute("aria-valuenow", String(Math.round(value)));
    localStorage.setItem(KEY, String(value));
    return value;
  };
  let now = Number(localStorage.getItem(KEY) ?? NaN);
  if (now >= LOW) set(now);
  else now = 42;
  bar.addEventListener("pointerdown", (event) => {
    bar.setPointerCapture(event.pointerId);
    event.preventDefault();
  });
  bar.addEventListener("pointermove", (event) => {
    if (!bar.hasPointerCapture(event.pointerId)) return;
    const box = main.getBoundingClientRect();
    now = set((100 * (event.clientX - box.left)) / box.width);
  });
  bar.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -STEP, ArrowRight: STEP }[event.key];
    if (step === undefined) return;
    now = set(now + step);
    event.preventDefault();
  });
}
