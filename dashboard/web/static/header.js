/** The head of the page: clock, which time is shown, the next cycle, links. */

import { byId, setText } from "./dom.js";
import { hashOf } from "./router.js";

const THEMES = { system: "light", light: "dark", dark: "system" };
const THEME_ICONS = { system: "contrast", light: "sun", dark: "moon" };

/** Draws the header. */
export class Header {
  /** @param {any} config @param {import("./format.js").Format} format */
  constructor(config, format) {
    this.config = config;
    this.format = format;
    setText(byId("title"), config.title && config.title !== "Slipstream" ? config.title : "");
    byId("version").textContent = config.version ? `version ${config.version}` : "";
    byId("scene").hidden = !config.scene_url;
    byId("reports").hidden = !config.history;
    this.link(null);
    byId("theme").addEventListener("click", () => {
      dispatchEvent(new CustomEvent("choosetheme", { detail: THEMES[document.documentElement.dataset.themeChoice ?? "system"] }));
    });
    addEventListener("themechange", () => this._theme());
    this._theme();
    byId("report-day").value = format.isoDay(Date.now());
    byId("report-day").max = format.isoDay(Date.now());
  }

  /** Points the link to the 3D view at the selection. @param {{kind: string, id: string}|null} selection */
  link(selection) {
    if (!this.config.scene_url) return;
    const url = new URL(this.config.scene_url, location.href);
    if (selection) url.searchParams.set("select", hashOf(selection).slice(1));
    byId("scene").href = url.href;
  }

  /** Each second. @param {import("./store.js").Store} shown @param {number} now the moment shown @param {boolean} control whether the dispatcher can be asked for anything */
  tick(shown, now, control) {
    const { format: f } = this;
    const state = document.documentElement.dataset;
    const lost = state.connection === "lost" || state.connection === "none";
    const past = state.time === "past";
    const wrong = new Set((shown.status?.items ?? []).map((item) => item.subject));
    const silent = wrong.has("bus");
    const dead = wrong.has("fleet");
    setText(byId("clock"), f.clock(now));
    setText(byId("zone"), f.zone(now));
    setText(byId("date"), f.date(now));
    const badge = byId("badge");
    badge.dataset.state = past ? "past" : lost || silent || dead ? "lost" : "live";
    setText(badge, past ? "Past" : lost ? "No connection" : silent ? "Not up to date" : dead ? "Fleet silent" : "Live");
    setText(byId("next"), this._next(shown, now, past));
    byId("control").hidden = !control;
    byId("pause").hidden = shown.paused;
    byId("solve").hidden = shown.paused;
    byId("resume").hidden = !shown.paused;
  }

  _next(shown, now, past) {
    if (past || shown.t === null) return "";
    if (shown.paused) return "dispatcher paused";
    if (shown.next_cycle === null) return "";
    const seconds = Math.round((shown.next_cycle - now) / 1000);
    return seconds > 0 ? `next cycle in ${this.format.duration(seconds)}` : "next cycle is due";
  }

  _theme() {
    const choice = document.documentElement.dataset.themeChoice ?? "system";
    const button = byId("theme");
    button.querySelector("use").setAttribute("href", `static/icons.svg#${THEME_ICONS[choice]}`);
    button.setAttribute("aria-label", `Colours: ${choice}. Change to ${THEMES[choice]}.`);
    button.title = `Colours: ${choice}`;
  }
}
