/**
 * The way of the tool: how long it is, where it leads, and how deep the tool was along it.
 *
 * Steps shorter than what an arm's encoders make of rest are no way.
 */

import { isFinite3, length, scale, subtract } from "./math.js";

/** m */
const STEP_M = 20e-6;
/** Steps that are kept. */
const MOST_STEPS = 1 << 14;

/** @typedef {{way_mm: number, least_mm: number, most_mm: number}} Step place along the path, least and largest depth there */

export class ToolPath {
  constructor() {
    this.clear();
  }

  clear() {
    /** @type {Step[]} */
    this.steps = [];
    /** Unit vector of the last step, world; null before the first. @type {?number[]} */
    this.direction = null;
    this.at = null;
    this.time_ns = -Infinity;
    this.scene = null;
  }

  /** Length so far, mm. */
  get way_mm() {
    return this.steps.at(-1)?.way_mm ?? 0;
  }

  /** @param {object} state the newest */
  push(state) {
    const { p } = state.tool_cp;
    // A loop that began anew has a time of its own.
    if (state.time_ns < this.time_ns || state.scene_idx !== this.scene) this.clear();
    this.time_ns = state.time_ns;
    this.scene = state.scene_idx;
    if (!isFinite3(p)) return;
    // Every tick since the last state counts.
    const depths = [state.max_depth_m * 1e3, ...(state.history ?? []).map((row) => row[2])].filter(Number.isFinite);
    if (depths.length === 0) return;
    const [least_mm, most_mm] = [Math.min(...depths), Math.max(...depths)];
    const step = this.at && subtract(p, this.at);
    if (step && length(step) < STEP_M) {
      const last = this.steps.at(-1);
      Object.assign(last, { least_mm: Math.min(last.least_mm, least_mm), most_mm: Math.max(last.most_mm, most_mm) });
      return;
    }
    const way_mm = step ? this.way_mm + length(step) * 1e3 : 0;
    if (step) this.direction = scale(step, 1 / length(step));
    this.at = p;
    this.steps.push({ way_mm, least_mm, most_mm });
    if (this.steps.length > MOST_STEPS) this.steps.splice(0, MOST_STEPS / 2);
  }
}
