/** Movable parts: where each stands, and fields to put it elsewhere. The loop brings it there without a jump. */

import { byId, element, words } from "./element.js";
import { isFinite3 } from "./math.js";
import { fixed, short } from "./units.js";

const AXES = ["x", "y", "z"];
const EVERY_MS = 200;

export class Objects {
  /** @param {import("./link.js").Link} link */
  constructor(link) {
    this.link = link;
    this.rows = [];
    this.shownAt = 0;
  }

  /** @param {object[]} objects of the scene */
  learn(objects) {
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
      if (row.error) continue;
      row.answer.textContent = `stands at ${row.pose.p.map((x) => fixed(x * 1e3, 2)).join(", ")} mm`;
    }
  }

  #row(object, idx) {
    const fields = AXES.map((axis, n) =>
      element("input", { type: "number", step: "0.5", value: short(object.pose.p[n] * 1e3), "aria-label": `${object.name}, ${axis}, mm` }),
    );
    const answer = element("p", { class: "answer" });
    const row = { idx, name: object.name, pose: object.pose, fields, answer, error: false };
    row.root = element(
      "fieldset",
      { class: "object", id: `object-${object.name}` },
      element("legend", {}, object.name),
      ...fields.map((field, n) => element("label", {}, `${AXES[n]}, mm`, field)),
      answer,
    );
    for (const field of fields) field.onchange = () => this.#place(row);
    return row;
  }

  async #place(row) {
    const p = row.fields.map((field) => field.valueAsNumber / 1e3);
    if (!isFinite3(p)) return;
    row.error = false;
    try {
      await this.link.send("place", { object: row.name, pose: { p, q: row.pose.q } });
    } catch (error) {
      row.error = true;
      row.answer.textContent = words(error);
    }
  }
}
