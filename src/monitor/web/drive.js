/**
 * Whether force flows, and the three buttons about it.
 *
 * Disable and Stop always act at once, and are never greyed out: what the page believes of the loop may be old. Escape is Disable, wherever
 * the focus is.
 */

import { byId, element, say, words } from "./element.js";

/** What a phase of the run means for the hand. */
const NOTES = {
  init: "starting",
  baking: "the parts are being prepared",
  disabled: "no force",
  enabling: "force comes in",
  enabled: "force is on",
  stopping: "force goes out",
  braking: "the arm brakes",
  fault: "no force until it is enabled again",
  stopped: "the run is over",
};

/** @param {object} state @returns {"enabled"|"busy"|"fault"|"disabled"} what it comes down to */
function kindOf({ state, is_busy: isBusy }) {
  if (state === "FAULT") return "fault";
  if (state === "PAUSED" || isBusy) return "busy";
  return state === "ENABLED" ? "enabled" : "disabled";
}

export class Drive {
  /** @param {import("./link.js").Link} link */
  constructor(link) {
    this.link = link;
    /** @type {Map<string, string>} faults in plain words, by name */
    this.faultWords = new Map();
    this.shown = "";
    this.phase = "";
    byId("enable").onclick = () => this.#order("enable");
    byId("banner-enable").onclick = () => this.#order("enable");
    byId("disable").onclick = () => this.#order("disable");
    byId("stop").onclick = () => this.#order("stop");
    addEventListener(
      "keydown",
      (event) => {
        if (event.key === "Escape" && !event.repeat) this.#order("disable");
      },
      { capture: true },
    );
  }

  /** @param {{name: string, text: string}[]} faults */
  learn(faults) {
    for (const { name, text } of faults) this.faultWords.set(name, text);
    this.shown = "";
  }

  /** Before the first state of a run. @param {string} phase */
  greet(phase) {
    this.shown = "";
    byId("state-word").textContent = phase.charAt(0).toUpperCase() + phase.slice(1);
    byId("state-note").textContent = NOTES[phase] ?? "";
  }

  /** The connection is gone, and with it all knowledge of the loop. */
  lose() {
    document.body.dataset.state = "waiting";
    byId("state-word").textContent = "Unknown";
    byId("state-note").textContent = this.phase && `${this.phase} when last heard of`;
    this.shown = "";
  }

  /** @param {object} state the newest */
  show(state) {
    const { phase, off_cause: cause, advice, faults } = state;
    // Writing the same again would make screen readers repeat it.
    const news = [state.state, state.is_busy, phase, cause, advice, faults].join();
    if (news === this.shown) return;
    this.shown = news;
    this.phase = phase;

    const kind = kindOf(state);
    document.body.dataset.state = kind;
    byId("state-word").textContent = phase.charAt(0).toUpperCase() + phase.slice(1);
    byId("state-note").textContent = [NOTES[phase] ?? state.state.toLowerCase(), kind === "disabled" && advice].filter(Boolean).join("; ");
    byId("enable").disabled = kind === "enabled" || phase === "enabling" || phase === "stopped";
    byId("enable").textContent = kind === "fault" ? "Enable again" : "Enable";

    byId("banner").hidden = kind !== "fault";
    if (kind !== "fault") return;
    byId("banner-title").textContent = "Fault: the force is off";
    byId("banner-faults").replaceChildren(...faults.map((name) => this.#fault(name)));
    byId("banner-advice").textContent = advice ?? "";
  }

  #fault(name) {
    const text = this.faultWords.get(name);
    return text ? element("li", {}, `${text} (${name})`) : element("li", {}, name);
  }

  async #order(what) {
    try {
      await this.link.order(what);
    } catch (error) {
      say(`${what} was not done: ${words(error)}`);
    }
  }
}
