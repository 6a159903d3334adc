/** What belongs to the whole session: other scenes, the recording, and whether this page guards the run. */

import { byId, element, say, words } from "./element.js";
import { count } from "./units.js";

/** A guarding page that is silent for longer than this takes the force away. A tab in the background may beat once a second. */
const GUARD_TIMEOUT_MS = 2500;
/** What the box says while nobody has asked for a guard. */
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
    const lost = recording?.dropped > 0 ? `, ${count(recording.dropped)} lost` : "";
    byId("record-facts").textContent = recording ? `${recording.file}: ${count(recording.records)} ticks${lost}` : "not recording";
    const guard = byId("guard");
    if (heartbeatMs && !guard.checked) {
      // The scene gives force only to a client that beats.
      this.heartbeatMs = heartbeatMs;
      guard.checked = true;
      guard.disabled = true;
      this.guard();
    }
  }

  /** Begins or ends the beats as the box says; also after the connection broke, which the server took for silence. */
  async guard() {
    clearInterval(this.beating);
    const timeout_ms = byId("guard").checked ? (this.heartbeatMs ?? GUARD_TIMEOUT_MS) : 0;
    const answer = byId("guard-answer");
    try {
      await this.link.send("heartbeat", { timeout_ms });
    } catch (error) {
      // A guard that the server has not heard of must not look like one.
      answer.textContent = timeout_ms > 0 ? `not on guard: ${words(error)}` : GUARD_OFFER;
      say(words(error));
      return;
    }
    answer.textContent = timeout_ms > 0 ? "on guard" : GUARD_OFFER;
    if (timeout_ms > 0) this.beating = setInterval(() => this.link.send("ping").catch(() => {}), timeout_ms / BEATS);
  }

  /** The connection is new. */
  resume() {
    if (byId("guard").checked) this.guard();
  }

  async #switch(event) {
    event.preventDefault();
    const scene = byId("scene-choice").value;
    say(`${scene} is being prepared; the force goes out while the scenes change`);
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
