/** What belongs to the whole session: other scenes, the recording, and whether this page guards the run. */

import { byId, element, say, words } from "./element.js";
import { count } from "./units.js";

/** A guarding page that is silent for longer than this takes the force away. */
const GUARD_TIMEOUT_MS = 2500;
/** What the box says while no guard was asked for. */
const GUARD_OFFER = "force goes off when this page falls silent";
/** Beats in that time. */
const BEATS = 5;
/** Baking another scene takes as long as it takes. */
const SWITCH_TIMEOUT_MS = 600_000;

export class Session {
  /** @param {import("./link.js").Link} link @param {() => void} changed called when the recording may have begun or ended */
  constructor(link, changed) {
    this.link = link;
    this.changed = changed;
    this.recording = null;
    /** What the last recording of this page came to. */
    this.lastRecording = "";
    /** @type {?number} longest silence that the scene allows */
    this.heartbeatMs = null;
    /** @type {?number} longest silence that this page allows itself, while it is on guard */
    this.silenceMs = null;
    this.beatAt = 0;
    /** @type {?number} timer of the beats */
    this.beating = null;
    byId("scene-form").onsubmit = (event) => this.#switch(event);
    byId("record-form").onsubmit = (event) => this.#record(event);
    byId("guard").onchange = () => this.guard();
  }

  /** @param {string[]} names @param {string} current */
  offer(names, current) {
    const choice = byId("scene-choice");
    choice.replaceChildren(...names.map((name) => element("option", { value: name, selected: name === current }, name)));
    for (const part of byId("scene-form").elements) part.disabled = names.length < 2;
  }

  /** @param {object} info */
  show({ recording, heartbeat_ms: heartbeatMs }) {
    this.recording = recording;
    byId("record-form").classList.toggle("is-recording", Boolean(recording));
    byId("record").textContent = recording ? "End" : "Record";
    byId("record-file").disabled = Boolean(recording);
    byId("record-facts").textContent = recording ? recordingText(recording) : this.lastRecording || "not recording";
    if (heartbeatMs === this.heartbeatMs) return;
    // The scene gives force only to a client that beats.
    this.heartbeatMs = heartbeatMs;
    Object.assign(byId("guard"), { checked: heartbeatMs !== null, disabled: heartbeatMs !== null });
    this.guard();
  }

  /** Something was recorded. @param {string} text */
  remember(text) {
    this.lastRecording = text;
  }

  /** Begins or ends the beats as the box says; also after the connection broke, which the server took for silence. */
  async guard() {
    clearInterval(this.beating);
    const wasOnGuard = this.silenceMs !== null;
    this.silenceMs = byId("guard").checked ? (this.heartbeatMs ?? GUARD_TIMEOUT_MS) : null;
    if (this.silenceMs !== null) {
      this.beating = setInterval(() => this.beatIfDue(), this.silenceMs / BEATS / 2);
      this.#beat();
      return;
    }
    answer(GUARD_OFFER);
    if (wasOnGuard) await this.link.send("heartbeat", { timeout_ms: 0 }).catch((error) => say(words(error)));
  }

  /** Called with every state: a hidden tab gets every state, but its timers only once a minute. */
  beatIfDue() {
    if (this.silenceMs !== null && performance.now() - this.beatAt >= this.silenceMs / BEATS) this.#beat();
  }

  /** Each beat says how long the next may take: whatever the server held for silence before, from now on this page is on guard. */
  async #beat() {
    const { silenceMs } = this;
    this.beatAt = performance.now();
    let said = "on guard";
    try {
      await this.link.send("heartbeat", { timeout_ms: silenceMs });
    } catch (error) {
      // A guard that the server has not heard of must not look like one.
      said = `not on guard: ${words(error)}`;
    }
    if (silenceMs === this.silenceMs) answer(said);
  }

  /** The connection is new. */
  resume() {
    if (byId("guard").checked) this.guard();
  }

  async #switch(event) {
    event.preventDefault();
    const scene = byId("scene-choice").value;
    say(`${scene} is being prepared; the force goes out for a moment when it takes over`);
    try {
      await this.link.send("switch", { scene }, SWITCH_TIMEOUT_MS);
    } catch (error) {
      say(`${scene} was not taken: ${words(error)}`);
    }
  }

  async #record(event) {
    event.preventDefault();
    const file = byId("record-file").value.trim();
    try {
      if (this.recording) await this.link.send("end_recording");
      else await this.link.send("record", file ? { file } : {});
    } catch (error) {
      say(words(error));
    }
    this.changed();
  }
}

function answer(text) {
  const shown = byId("guard-answer");
  // Writing the same again would make screen readers repeat it.
  if (shown.textContent !== text) shown.textContent = text;
}

function recordingText({ file, records, dropped }) {
  const lost = dropped > 0 ? `, ${count(dropped)} lost` : "";
  return `${file}: ${count(records)} ticks${lost}`;
}
