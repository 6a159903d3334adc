/**
 * Whether force flows, and the three buttons about it.
 *
 * Disable and Stop always act at once, and are never greyed out: what the page believes of the loop may be old. Where Stop would lose work, the
 * force goes off at once, and the run ends when that was answered. Escape is Disable, wherever the focus is.
 */

import { byId, element, say, words } from "./element.js";
import { NoAnswer } from "./link.js";

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
    /** The run has ended, or was told to. */
    this.isOver = false;
    /** This page has told it to end, and heard no refusal. */
    this.isToldToStop = false;
    /** Name of a scene that is on its way. */
    this.prepared = "";
    /** @type {?object} the newest state */
    this.state = null;
    byId("enable").onclick = () => this.#order("enable");
    byId("banner-enable").onclick = () => this.#order("enable");
    byId("disable").onclick = () => this.#order("disable");
    /** Asked before the run ends: true takes the rest over. */
    this.asksFirst = () => false;
    byId("stop").onclick = () => this.asksFirst() || this.stop();
    addEventListener(
      "keydown",
      (event) => {
        if (event.key === "Escape" && !event.repeat) this.#order("disable");
      },
      { capture: true },
    );
  }

  /** Ends the run. */
  stop() {
    return this.#order("stop");
  }

  /** @param {{name: string, text: string}[]} faults */
  learn(faults) {
    const isNews = faults.some(({ name, text }) => this.faultWords.get(name) !== text);
    for (const { name, text } of faults) this.faultWords.set(name, text);
    // Writing the banner again would make screen readers repeat it.
    if (isNews) this.shown = "";
  }

  /** Another scene is being baked; force goes on meanwhile. @param {string} name or nothing */
  prepare(name) {
    this.prepared = name;
    if (this.state) this.show(this.state);
  }

  /** A connection begins. @param {string} phase */
  greet(phase) {
    this.isOver = this.isToldToStop = false;
    byId("enable").disabled = false;
    this.phase = phase;
    this.#name(phase);
  }

  /** An event about the phase. @param {string} phase @param {boolean} isFirst before the first state of a run */
  hear(phase, isFirst) {
    this.phase = phase;
    this.isOver ||= phase === "stopped";
    if (isFirst) this.#name(phase);
  }

  #name(phase) {
    this.shown = "";
    byId("state-word").textContent = phase.charAt(0).toUpperCase() + phase.slice(1);
    byId("state-note").textContent = NOTES[phase] ?? "";
  }

  /** The connection is gone, and with it all knowledge of the loop. @param {boolean} isOver the server went away on purpose */
  lose(isOver) {
    this.isOver ||= isOver || this.isToldToStop;
    document.body.dataset.state = "waiting";
    byId("state-word").textContent = this.isOver ? "Stopped" : "Unknown";
    byId("state-note").textContent = this.isOver ? NOTES.stopped : this.phase && `${this.phase} when last heard of`;
    // The connection is closed.
    if (this.isOver) byId("enable").disabled = true;
    this.shown = "";
    this.prepared = "";
    this.state = null;
  }

  /** @param {object} state the newest */
  show(state) {
    this.state = state;
    const { phase, off_cause: cause, advice, faults, last_fault: lastFault } = state;
    // Writing the same again would make screen readers repeat it.
    const news = [state.state, state.is_busy, phase, cause, advice, faults, lastFault?.tick, this.prepared].join();
    if (news === this.shown) return;
    this.shown = news;
    this.phase = phase;

    const kind = kindOf(state);
    document.body.dataset.state = kind;
    byId("state-word").textContent = phase.charAt(0).toUpperCase() + phase.slice(1);
    const next = this.prepared && `${this.prepared} is being prepared`;
    // With force on there is advice where it flows no more, as outside of the workspace.
    const note = kind === "enabled" && advice ? NOTES.disabled : (NOTES[phase] ?? state.state.toLowerCase());
    byId("state-note").textContent = [note, kind !== "fault" && advice, next].filter(Boolean).join("; ");
    byId("enable").disabled = kind === "enabled" || phase === "enabling" || phase === "stopped";
    byId("enable").textContent = kind === "fault" ? "Enable again" : "Enable";

    // Also of one that a silence acknowledged, or another client: until a client enables.
    byId("banner").hidden = kind !== "fault" && !lastFault;
    if (byId("banner").hidden) return;
    const at = lastFault ? ` ${(lastFault.time_ns / 1e9).toFixed(2)} s after the start` : "";
    byId("banner-title").textContent = `Fault${at}: the force is off`;
    byId("banner-faults").replaceChildren(...(faults.length > 0 ? faults : lastFault.names).map((name) => this.#fault(name)));
    byId("banner-advice").textContent = advice ?? "";
  }

  #fault(name) {
    const text = this.faultWords.get(name);
    return text ? element("li", {}, `${text} (${name})`) : element("li", {}, name);
  }

  async #order(what) {
    if (what === "stop") this.isToldToStop = true;
    try {
      await this.link.order(what);
      // What the server took it does, even if its last words do not arrive.
      if (what === "stop") this.isOver = true;
    } catch (error) {
      // A page that is slow may not read the reply before the server is gone.
      if (what === "stop" && !(error instanceof NoAnswer)) this.isToldToStop = false;
      if (!this.isOver) say(`${what} was not done: ${words(error)}`);
    }
  }
}
