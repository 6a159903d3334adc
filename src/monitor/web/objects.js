/** Movable parts: where each stands, and fields to put it elsewhere. The loop brings it there without a jump. */

import { byId, element, words } from "./element.js";
import { isFinite3, length, subtract } from "./math.js";
import { readNumber, stepByKeys } from "./number-field.js";
import { fixed, short } from "./units.js";

const AXES = ["x", "y", "z"];
/** Of the arrow keys, mm. */
const STEP_MM = 0.5;
const EVERY_MS = 200;
/** Nearer than this a part is where it was wished. */
const ARRIVED_M = 1e-5;

export class Objects {
  /** @param {import("./link.js").Link} link */
  constructor(link) {
    this.link = link;
    this.rows = [];
    /** Box of the scene, m. */
    this.bounds = null;
    this.shownAt = 0;
  }

  /** @param {{objects: object[], bounds: ?{min: number[], max: number[]}}} scene */
  learn({ objects, bounds }) {
    this.bounds = bounds;
    this.rows = objects.flatMap((object, idx) => (object.movable ? [this.#row(object, idx)] : []));
    byId("objects").replaceChildren(...this.rows.map(({ root }) => root));
    byId("objects-box").hidden = this.rows.length === 0;
  }

  /** @param {object} state the newest */
  show(state) {
    const now = performance.now();
    if (now - this.shownAt < EVERY_MS) return;
    this.shownAt = now;
    for (const row of this.rows) {
      const live = state.objects?.find(({ idx }) => idx === row.idx);
      if (live && isFinite3(live.p)) row.pose = { p: live.p, q: live.q };
      if (row.wish && length(subtract(row.wish, row.pose.p)) < ARRIVED_M) row.wish = null;
      for (const [n, field] of row.fields.entries()) {
        if (!row.wish && !row.isTyped[n] && document.activeElement !== field) field.value = short(row.pose.p[n] * 1e3);
      }
      if (row.holdsAnswer) continue;
      const way = row.wish ? `, on its way to ${millimetres(row.wish)}` : "";
      row.answer.textContent = `stands at ${millimetres(row.pose.p)}${way}`;
    }
  }

  #row(object, idx) {
    const fields = AXES.map((axis, n) =>
      element("input", { type: "text", inputMode: "decimal", autocomplete: "off", value: short(object.pose.p[n] * 1e3), "aria-label": `${object.name}, ${axis}, mm` }),
    );
    const answer = element("p", { class: "answer" });
    const go = element("button", { type: "button", hidden: true }, "Move it there");
    // `isTyped`: which fields the user wrote into; the others follow the part. `holdsAnswer`: what stands below is an answer, not the place.
    const row = { idx, name: object.name, pose: object.pose, fields, answer, go, isTyped: [false, false, false], wish: null, holdsAnswer: false };
    row.root = element(
      "fieldset",
      { class: "object", id: `object-${object.name}` },
      element("legend", {}, object.name),
      ...fields.map((field, n) => element("label", {}, `${AXES[n]}, mm`, field)),
      answer,
      go,
    );
    for (const [n, field] of fields.entries()) {
      stepByKeys(field, STEP_MM);
      // An emptied field follows the part again.
      field.oninput = () => (row.isTyped[n] = field.value !== "");
      field.onchange = () => {
        field.oninput();
        this.#ask(row);
      };
    }
    go.onclick = () => this.#place(row);
    return row;
  }

  /** Where the fields say that the part is to be; what the user did not write into stays where it is, or is going, to the last digit. */
  #wish(row) {
    return row.fields.map((field, n) => (row.isTyped[n] ? readNumber(field.value) / 1e3 : (row.wish ?? row.pose.p)[n]));
  }

  #ask(row) {
    const p = this.#wish(row);
    row.go.hidden = true;
    row.holdsAnswer = false;
    if (!isFinite3(p)) {
      const wrong = row.fields.find((field, n) => row.isTyped[n] && Number.isNaN(readNumber(field.value)));
      row.holdsAnswer = true;
      row.answer.textContent = `“${wrong.value.trim()}” is no number: write one such as 1.5`;
      return;
    }
    if (!this.#isFar(p)) {
      this.#place(row);
      return;
    }
    // A slip of the finger is not to pull a part through the scene while force is on.
    row.go.hidden = false;
    row.holdsAnswer = true;
    row.answer.textContent = `${millimetres(p)} is far outside of the scene`;
  }

  /** Whether a place is further from the scene than the scene is large. */
  #isFar(p) {
    if (!this.bounds) return false;
    const { min, max } = this.bounds;
    const size = length(subtract(max, min));
    return p.some((x, n) => x < min[n] - size || x > max[n] + size);
  }

  async #place(row) {
    const p = this.#wish(row);
    row.go.hidden = true;
    row.holdsAnswer = false;
    try {
      await this.link.send("place", { object: row.name, pose: { p, q: row.pose.q } });
      row.wish = p;
      row.isTyped.fill(false);
    } catch (error) {
      row.holdsAnswer = true;
      row.answer.textContent = words(error);
    }
  }
}

const millimetres = (p) => `${p.map((x) => fixed(x * 1e3, 2)).join(", ")} mm`;
