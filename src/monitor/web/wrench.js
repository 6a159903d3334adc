/** Force and torque by component: what the parts do to the tool beside what the arm is told to render, both along the axes of world. */

import { byId, element } from "./element.js";
import { dot, isFinite3, length, rotate } from "./math.js";
import { fixed } from "./units.js";

const EVERY_MS = 100;

/** Key of the state, part of it, whether it stands along the arm's axes, how the unit is shown. */
const ROWS = [
  { id: "contact-force", label: "Contact force, N", of: ({ contact_cf: { f } }) => f, factor: 1, decimals: 2 },
  { id: "command-force", label: "Commanded force, N", of: ({ servo_cf: { f } }) => f, isOfDevice: true, factor: 1, decimals: 2 },
  { id: "contact-torque", label: "Contact torque, mN·m", of: ({ contact_cf: { t } }) => t, factor: 1e3, decimals: 1 },
  { id: "command-torque", label: "Commanded torque, mN·m", of: ({ servo_cf: { t } }) => t, isOfDevice: true, factor: 1e3, decimals: 1 },
];

export class Wrench {
  /** @param {import("./path.js").ToolPath} path */
  constructor(path) {
    this.path = path;
    /** Turns the arm's axes into those of world. */
    this.q = [0, 0, 0, 1];
    this.shownAt = 0;
    this.cells = ROWS.map(({ id, label }) => {
      const cells = [0, 1, 2, 3].map(() => element("td", {}));
      byId("wrench").tBodies[0].append(element("tr", { id }, element("th", { scope: "row" }, label), ...cells));
      return cells;
    });
  }

  /** @param {{world_from_device: {q: number[]}}} scene */
  learn({ world_from_device: pose }) {
    this.q = pose?.q ?? [0, 0, 0, 1];
  }

  /** @param {object} state the newest */
  show(state) {
    const now = performance.now();
    if (now - this.shownAt < EVERY_MS) return;
    this.shownAt = now;
    ROWS.forEach(({ of, isOfDevice, factor, decimals }, n) => {
      const vector = of(state);
      const isSound = isFinite3(vector);
      const world = isSound && isOfDevice ? rotate(this.q, vector) : vector;
      const values = isSound ? [...world, length(world)] : [null, null, null, null];
      values.forEach((value, axis) => (this.cells[n][axis].textContent = fixed(value === null ? null : value * factor, decimals)));
    });
    const { f } = state.contact_cf;
    const { direction } = this.path;
    // What resists the motion is positive.
    const along = direction && isFinite3(f) ? -dot(f, direction) : null;
    byId("insertion-force").textContent = fixed(along, 2);
  }
}
