/**
 * The parameters of the scene: a slider and a field each, in the units of the scene file.
 *
 * A value is sent while it is dragged, the newest only; what stands below is what the server says it has.
 */

import { byId, element, words } from "./element.js";
import { readNumber, refusal } from "./number-field.js";
import { parameterWords, short } from "./units.js";

const STEPS = 1000;
/** A range over this ratio is walked by ratios, not by differences. */
const WIDE = 20;
/** While a slider is dragged this often, ms. */
const SEND_EVERY_MS = 60;

/** What the loop does where two values do not go together. */
const BOUNDS = {
  friction_dynamic: { by: "friction_static", holds: (value, other) => value <= other, words: "never above static friction" },
  filter_cutoff_high_hz: { by: "filter_cutoff_low_hz", holds: (value, other) => value >= other, words: "never below the low cut-off" },
};

/** @typedef {{name: string, value: number, least: number, most: number, scene: number}} Parameter SI */

export class Parameters {
  /**
   * @param {import("./link.js").Link} link
   * @param {(parameters: Parameter[]) => void} heard
   */
  constructor(link, heard) {
    this.link = link;
    this.heard = heard;
    /** @type {Map<string, Row>} */
    this.rows = new Map();
  }

  /** Asks the server for all of them. */
  async refresh() {
    /** @type {Parameter[]} */
    const parameters = await this.link.get("parameters");
    const names = parameters.map(({ name }) => name);
    if (names.join() !== [...this.rows.keys()].join()) {
      this.rows = new Map(names.map((name) => [name, new Row(name, (value) => this.#set(name, value))]));
      const rows = [...this.rows.values()].map(({ root }) => root);
      byId("parameters").replaceChildren(...(rows.length > 0 ? rows : [element("p", { class: "none" }, "this scene has none")]));
    }
    const valueOf = (name) => parameters.find((parameter) => parameter.name === name)?.value;
    for (const parameter of parameters) this.rows.get(parameter.name).take(parameter, boundOf(parameter, valueOf));
    this.heard(parameters);
  }

  async #set(parameter, value) {
    await this.link.send("set", { parameter, value });
    await this.refresh();
  }
}

/**
 * What a parameter is held to by another one, where it is.
 * @param {Parameter} parameter @param {(name: string) => number|undefined} valueOf
 * @returns {?string} in words
 */
function boundOf({ name, value }, valueOf) {
  const bound = BOUNDS[name];
  const other = bound && valueOf(bound.by);
  if (other === undefined || bound.holds(value, other)) return null;
  return `acts as ${short(other)}: ${bound.words}`;
}

/** One parameter in the page. */
export class Row {
  /** @param {string} name @param {(value: number) => Promise<void>} set SI */
  constructor(name, set) {
    this.set = set;
    this.words = parameterWords(name);
    const { label, unit } = this.words;
    this.slider = element("input", { type: "range", id: `slider-${name}`, min: "0", max: String(STEPS), step: "1" });
    this.field = element("input", { type: "text", inputMode: "decimal", autocomplete: "off", id: `field-${name}`, "aria-label": unit ? `${label}, ${unit}` : label });
    this.reset = element("button", { type: "button", class: "reset" }, "↺");
    this.answer = element("span", { class: "answer", id: `answer-${name}`, role: "status" });
    this.slider.setAttribute("aria-describedby", this.answer.id);
    this.root = element(
      "div",
      { class: "parameter", id: `parameter-${name}` },
      element("label", { htmlFor: this.slider.id }, unit ? `${label}, ${unit}` : label),
      this.answer,
      this.slider,
      this.field,
      this.reset,
    );
    this.slider.oninput = () => this.#ask(this.#ofSlider(), true);
    this.slider.onchange = () => this.#ask(this.#ofSlider(), false);
    // A number that the user is writing is left alone, whatever the server says meanwhile.
    this.isTyping = false;
    this.field.oninput = () => (this.isTyping = true);
    this.field.onchange = () => {
      this.isTyping = false;
      this.#askTyped();
    };
    this.field.onblur = () => {
      this.isTyping = false;
      if (!this.isSending && this.next === null && this.parameter) this.#write(this.parameter.value);
    };
    this.reset.onclick = () => this.#ask(this.parameter.scene, false);
    this.isSending = false;
    /** @type {?string} */
    this.bound = null;
    /** @type {?number} what to send when the answer to the last one is there, SI */
    this.next = null;
  }

  /** What the server has. @param {Parameter} parameter @param {?string=} bound what it is held to, in words */
  take(parameter, bound = this.bound) {
    this.parameter = parameter;
    this.bound = bound;
    const { least, most, scene, value } = parameter;
    const { label, unit, factor } = this.words;
    this.slider.style.setProperty("--scene", `calc(11px + ${this.#share(scene)} * (100% - 22px))`);
    const hint = `Reset ${label.toLowerCase()} to the scene's ${short(scene * factor)} ${unit}`.trim();
    this.reset.title = hint;
    this.reset.setAttribute("aria-label", hint);
    this.reset.disabled = value === scene;
    if (this.isSending || this.next !== null) return;
    this.root.classList.remove("is-waiting", "is-refused");
    this.#write(value);
    this.root.classList.toggle("is-set", value !== scene);
    this.answer.textContent = bound ?? this.#standing();
  }

  #standing() {
    const { least, most, scene, value } = this.parameter;
    const { factor } = this.words;
    return value === scene ? `${short(least * factor)} to ${short(most * factor)}` : `set, scene ${short(scene * factor)}`;
  }

  /** What was written into the field; what is out of range is refused here, in the units of the field. */
  #askTyped() {
    const { least, most, value } = this.parameter;
    const { factor, unit } = this.words;
    const text = this.field.value;
    if (text.trim() === "") {
      this.#write(value);
      return;
    }
    const problem = refusal(text, least * factor, most * factor, unit);
    if (problem) this.#refuse(problem);
    else this.#ask(readNumber(text) / factor, false);
  }

  #refuse(problem) {
    this.#write(this.parameter.value);
    this.root.classList.remove("is-waiting");
    this.root.classList.add("is-refused");
    this.answer.textContent = problem;
  }

  /** @param {number} value SI @param {boolean} isDragging */
  async #ask(value, isDragging) {
    const { least, most } = this.parameter;
    // A bound in three figures, and a slider's end, may lie beyond it by rounding.
    const wanted = Math.min(most, Math.max(least, value));
    this.root.classList.remove("is-refused");
    this.#write(wanted);
    this.root.classList.add("is-waiting");
    this.answer.textContent = "asking …";
    this.next = wanted;
    if (this.isSending) return;
    this.isSending = true;
    try {
      while (this.next !== null) {
        const now = this.next;
        this.next = null;
        await this.set(now);
        if (isDragging) await new Promise((done) => setTimeout(done, SEND_EVERY_MS));
      }
      this.isSending = false;
      this.take(this.parameter);
    } catch (error) {
      this.isSending = false;
      this.next = null;
      this.#refuse(words(error));
    }
  }

  #write(value) {
    const share = this.#share(value);
    this.slider.value = String(Math.round(share * STEPS));
    this.slider.style.setProperty("--share", `calc(11px + ${share} * (100% - 22px))`);
    this.slider.setAttribute("aria-valuetext", `${short(value * this.words.factor)} ${this.words.unit}`.trim());
    if (!this.isTyping) this.field.value = short(value * this.words.factor);
  }

  get #isWide() {
    const { least, most } = this.parameter;
    return least > 0 && most / least > WIDE;
  }

  /** Where a value stands on the slider, 0 to 1. */
  #share(value) {
    const { least, most } = this.parameter;
    if (most <= least) return 0;
    return this.#isWide ? Math.log(value / least) / Math.log(most / least) : (value - least) / (most - least);
  }

  #ofSlider() {
    const { least, most, scene } = this.parameter;
    const share = this.slider.valueAsNumber / STEPS;
    // The scene's own value can be hit with a finger.
    if (Math.abs(share - this.#share(scene)) < 0.006) return scene;
    return this.#isWide ? least * (most / least) ** share : least + share * (most - least);
  }
}
