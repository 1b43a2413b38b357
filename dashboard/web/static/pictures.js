/** Pictures of cameras: asked for one after the other while they are in view, each told with the time that it was taken. */

import { pictureUrl } from "./boxes.js";
import { h, setText } from "./dom.js";

/** A browser keeps six connections to one host: more at once would leave none for the rest of the page. */
const AT_ONCE = 2;
const REST_MS = 250;
const WITHIN_MS = 5000;
/** Older than this, a picture is no picture of now: it is grey, with its age. */
export const STALE_MS = 5000;
const TAKEN = "X-Picture-Taken";

/** What a picture's figure begins with; `showPictures` fills it. @param {string} id of a roadside unit @returns {HTMLElement[]} */
export function pictureParts(id) {
  return [h("img", { alt: `Picture of ${id}`, hidden: true }), h("p.wait", {}, "Waiting for a picture…"), h("p.age", { hidden: true })];
}

/** Keeps all figures with `data-picture` up that are in view. @param {import("./format.js").Format} format */
export function showPictures(format) {
  let turn = 0;
  const work = async () => {
    for (;;) {
      const figures = document.hidden ? [] : [...document.querySelectorAll("figure[data-picture]")].filter(inView);
      if (figures.length) await ask(/** @type {HTMLElement} */ (figures[(turn += 1) % figures.length]), format);
      await new Promise((resolve) => setTimeout(resolve, REST_MS));
    }
  };
  for (let i = 0; i < AT_ONCE; i += 1) work();
  setInterval(() => {
    for (const figure of document.querySelectorAll("figure[data-picture]")) tellAge(figure, format);
  }, 1000);
}

async function ask(figure, format) {
  const id = /** @type {string} */ (figure.dataset.picture);
  const image = /** @type {HTMLImageElement} */ (figure.querySelector("img"));
  try {
    const answer = await fetch(pictureUrl(id), { cache: "no-store", signal: AbortSignal.timeout(WITHIN_MS) });
    if (!answer.ok) throw new Error(`HTTP ${answer.status}`);
    const picture = await answer.blob();
    if (!figure.isConnected || figure.dataset.picture !== id) return;
    release(image);
    image.src = URL.createObjectURL(picture);
    image.hidden = false;
    figure.querySelector(".wait").hidden = true;
    figure.dataset.taken = answer.headers.get(TAKEN) ?? String(Date.now());
  } catch {
    // The last one stays, and grows old. The banner says where the server is away.
    if (image.hidden) setText(figure.querySelector(".wait"), "It sends no picture now.");
  }
  tellAge(figure, format);
}

/** Says how old a picture is, once it is none of now. */
function tellAge(figure, format) {
  const image = figure.querySelector("img");
  const line = figure.querySelector(".age");
  if (!image || image.hidden || !line) return;
  const taken = Number(figure.dataset.taken);
  const age = Date.now() - taken;
  const stale = Math.abs(age) > STALE_MS;
  figure.classList.toggle("stale", stale);
  line.hidden = !stale;
  if (stale) setText(line, age < 0 ? "Its clock is ahead of this one's" : `Old: of ${format.since(taken)}, ${format.duration(age / 1000)} ago`);
  image.alt = `${stale ? "Old picture" : "Picture"} of ${figure.dataset.picture}`;
}

function inView(figure) {
  const box = figure.getBoundingClientRect();
  if (!box.width || box.bottom < 0 || box.top > innerHeight) return false;
  const pane = figure.closest(".pane, #card-body")?.getBoundingClientRect();
  return !pane || (box.bottom > pane.top && box.top < pane.bottom);
}

/** Frees the memory of a picture. @param {HTMLImageElement} image */
export function release(image) { if (image.src.startsWith("blob:")) URL.revokeObjectURL(image.src); }
