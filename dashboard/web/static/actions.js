/** Actions on the dispatcher. Each is asked for in a dialog and answered in it. */

import { getJson } from "./api.js";
import { byId, h, setText } from "./dom.js";

const TOKEN = "slipstream.token";

const QUESTIONS = {
  pause: ["Pause the dispatcher?", "No further cycle starts until it is resumed. Vehicles keep the plans that they have.", "Pause"],
  resume: ["Resume the dispatcher?", "Cycles start again.", "Resume"],
  solve: ["Solve now?", "A cycle starts at once, besides those of the schedule.", "Solve now"],
  pin: ["Lock the order to a vehicle?", "The dispatcher gives it to no other vehicle until it is released.", "Lock"],
  release: ["Release the order?", "The dispatcher may give it to any vehicle again.", "Release"],
  cancel: ["Cancel the order?", "It will not be served. This cannot be taken back.", "Cancel the order"],
  acknowledge: ["Acknowledge the alarm?", "Others see that you know of it. It stays until its cause is gone.", "Acknowledge"],
};

/** "it is over" as "It is over." @param {string} text */
function sentence(text) { return `${text[0].toUpperCase()}${text.slice(1)}${/[.!?]$/.test(text) ? "" : "."}`; }

/** The dialog of all actions. */
export class Actions {
  /** @param {() => Iterable<string>} vehicles names that an order can be locked to */
  constructor(vehicles) {
    this.vehicles = vehicles;
    this.dialog = /** @type {HTMLDialogElement} */ (byId("action"));
    this.form = /** @type {HTMLFormElement} */ (byId("action-form"));
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this._send();
    });
    byId("action-close").addEventListener("click", () => this.dialog.close());
  }

  /** Asks whether to do it. @param {string} action @param {string} subject @param {string|null} vehicle the one proposed @param {string|null} only the one that alone can be */
  ask(action, subject, vehicle = null, only = null) {
    const [title, text, button] = QUESTIONS[action];
    this.asked = { action, subject };
    setText(byId("action-title"), title);
    setText(byId("action-text"), text);
    setText(byId("action-subject"), subject === "dispatcher" ? "" : subject.replace("/", " "));
    setText(byId("action-send"), button);
    setText(byId("action-answer"), "");
    byId("action-close").textContent = "Do not";
    byId("action-send").hidden = false;
    byId("action-send").disabled = false;
    const pick = byId("action-vehicle");
    byId("action-vehicle-line").hidden = action !== "pin";
    pick.required = action === "pin";
    if (action === "pin") {
      pick.replaceChildren(h("option", { value: "" }, "choose one"), ...(only === null ? [...this.vehicles()] : [only]).map((id) => h("option", { value: id }, id)));
      pick.value = vehicle ?? "";
    }
    byId("action-reason").value = "";
    this._askToken(!sessionStorage.getItem(TOKEN));
    this.dialog.showModal();
  }

  _askToken(needed) {
    byId("action-token-line").hidden = !needed;
    const field = byId("action-token");
    field.required = needed;
    field.value = "";
  }

  async _send() {
    const typed = byId("action-token").value.trim();
    if (typed) sessionStorage.setItem(TOKEN, typed);
    const button = byId("action-send");
    const answer = byId("action-answer");
    button.disabled = true;
    setText(answer, "Asking the dispatcher…");
    try {
      const { text } = await getJson("api/actions", {
        method: "POST",
        headers: { "Content-Type": "application/json", Authorization: `Bearer ${sessionStorage.getItem(TOKEN)}` },
        body: JSON.stringify({
          ...this.asked,
          vehicle: this.asked.action === "pin" ? byId("action-vehicle").value : null,
          reason: byId("action-reason").value.trim() || null,
        }),
      });
      answer.dataset.level = "ok";
      setText(answer, text);
      button.hidden = true;
      byId("action-close").textContent = "Close";
      byId("action-close").focus();
    } catch (error) {
      answer.dataset.level = "bad";
      setText(answer, sentence(error.message));
      if (error.status === 401 || error.status === 403) {
        sessionStorage.removeItem(TOKEN);
        this._askToken(true);
      }
    } finally {
      button.disabled = false;
    }
  }
}
