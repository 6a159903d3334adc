/** The large numbers. They change ten times a second: faster cannot be read. */

import { byId } from "./element.js";
import { isFinite3, length } from "./math.js";
import { fixed, NONE, short } from "./units.js";

const EVERY_MS = 100;

export class Readouts {
  constructor() {
    this.limits = { force_n: null, torque_nm: null };
    this.shownAt = 0;
  }

  /** @param {{name: string, value: number}[]} parameters */
  learn(parameters) {
    const value = (name) => parameters.find((parameter) => parameter.name === name)?.value ?? null;
    this.limits = { force_n: value("limit_force_n"), torque_nm: value("limit_torque_nm") };
  }

  /** @param {object} state the newest */
  show(state) {
    const now = performance.now();
    if (now - this.shownAt < EVERY_MS) return;
    this.shownAt = now;
    const { servo_cf: command, measured_cf: made, measured_cv: motion } = state;
    write("read-force", fixed(size(command.f), 2));
    write("made-force", `arm ${fixed(size(made.f), 2)}`);
    write("limit-force", limit(this.limits.force_n));
    write("read-torque", fixed(size(command.t) * 1e3, 1));
    write("made-torque", `arm ${fixed(size(made.t) * 1e3, 1)}`);
    write("limit-torque", limit(this.limits.torque_nm, 1e3));
    write("read-depth", `${state.depth_is_bound ? "≥ " : ""}${fixed(state.max_depth_m * 1e3, 3)}`);
    write("read-clearance", state.clearance_m === null ? NONE : fixed(Math.max(0, state.clearance_m) * 1e3, 2));
    write("read-contacts", String(state.contacts ?? NONE));
    write("read-speed", fixed(size(motion.v) * 1e3, 1));
  }
}

const limit = (value, factor = 1) => (value === null ? "" : `limit ${short(value * factor)}`);

const size = (vector) => (isFinite3(vector) ? length(vector) : Number.NaN);

function write(id, text) {
  byId(id).textContent = text;
}
