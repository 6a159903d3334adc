/**
 * A section plane across x, y or z: what lies beyond it is left out of the picture, and what it cuts through has a flat, hatched face, as on
 * a drawing. Clay is cut too, but has no face: its samples lie on the surface only.
 */

import { onChange, rgb } from "./colors.js";
import { byId } from "./element.js";
import { matrixOfPose } from "./math.js";
import { readNumber, refusal } from "./number-field.js";
import { short } from "./units.js";

const STEPS = 1000;
/** How far the slider goes beyond the parts, as a share of their size. */
const BEYOND = 0.1;
/** Between two lines of the hatching, CSS pixels. */
const HATCH = 9;

export class Section {
  /** @param {import("./scene.js").SceneView} view */
  constructor(view) {
    this.view = view;
    this.isOn = false;
    /** 0, 1, 2: x, y, z. */
    this.axis = 1;
    /** 1: what has the larger coordinates is left out; −1: the smaller ones. */
    this.sign = 1;
    /** Coordinate of the plane, m; null: the middle of the parts. @type {?number} */
    this.place = null;
    this.cutsTool = true;
    this.#readColors();
    onChange(() => this.#readColors());
    this.slider = byId("section-slider");
    this.field = byId("section-place");
    byId("section").onclick = () => this.#turn(!this.isOn);
    for (const button of document.querySelectorAll("[data-axis]")) button.onclick = () => this.#cutAlong(Number(button.dataset.axis));
    byId("section-flip").onclick = () => {
      this.sign = -this.sign;
      view.redraw();
    };
    byId("section-tool").onchange = ({ target }) => {
      this.cutsTool = target.checked;
      view.redraw();
    };
    this.slider.oninput = () => {
      const [low, high] = this.#range;
      this.#move(low + (high - low) * (this.slider.valueAsNumber / STEPS));
    };
    this.field.onchange = () => this.#write();
    view.additions.push(this);
  }

  /** Plane beyond which what has this role is left out. @returns {?number[]} */
  cutOf(role) {
    if (!this.isOn || (role === "tool" && !this.cutsTool)) return null;
    const cut = [0, 0, 0, this.sign * this.#at];
    cut[this.axis] = this.sign;
    return cut;
  }

  /** The cut faces. @param {import("./draw.js").Draw} draw @param {number} ratio */
  among(draw, ratio) {
    if (!this.isOn) return;
    const { middle, radius } = this.view.camera.subject;
    for (const part of this.view.parts) {
      const cut = this.cutOf(part.role);
      // A face of a fixed part would hide what X-ray is to show.
      if (!cut || (part.role === "static" && this.view.isSeeThrough)) continue;
      draw.cut = cut;
      const [color, slant] = part.role === "tool" ? [this.colors.tool, -1] : [this.colors.part, 1];
      draw.cap(part, matrixOfPose(this.view.standing(part)), color, slant, HATCH * ratio, middle, 6 * radius);
      draw.cut = null;
    }
  }

  /** There are other parts, or more of them. */
  measured() {
    const [low, high] = this.#range;
    if (this.place !== null && (this.place < low || this.place > high)) this.place = null;
    this.#show();
  }

  /** Least and most that the slider goes to, m. */
  get #range() {
    const { min, max } = this.view.box;
    const [low, high] = [min[this.axis], max[this.axis]];
    const beyond = BEYOND * (high - low) || 1e-3;
    return [low - beyond, high + beyond];
  }

  get #at() {
    const { min, max } = this.view.box;
    return this.place ?? (min[this.axis] + max[this.axis]) / 2;
  }

  #turn(isOn) {
    this.isOn = isOn;
    byId("section").setAttribute("aria-pressed", String(isOn));
    byId("section-box").hidden = !isOn;
    if (isOn) this.#cutAlong(this.axis);
    else this.view.redraw();
  }

  /** Leaves out what is nearer to the eye. @param {number} axis */
  #cutAlong(axis) {
    if (axis !== this.axis) this.place = null;
    this.axis = axis;
    this.sign = this.view.camera.backward[axis] < 0 ? -1 : 1;
    for (const button of document.querySelectorAll("[data-axis]")) button.setAttribute("aria-pressed", String(Number(button.dataset.axis) === axis));
    this.#show();
    this.view.redraw();
  }

  #move(place) {
    this.place = place;
    this.#show();
    this.view.redraw();
  }

  #write() {
    const [low, high] = this.#range.map((place) => place * 1e3);
    const problem = refusal(this.field.value, low, high, "mm");
    byId("section-problem").textContent = problem;
    if (!problem) this.#move(readNumber(this.field.value) / 1e3);
  }

  #show() {
    const [low, high] = this.#range;
    const share = (this.#at - low) / (high - low);
    this.slider.value = String(Math.round(STEPS * share));
    this.slider.style.setProperty("--share", `calc(11px + ${share} * (100% - 22px))`);
    this.slider.setAttribute("aria-valuetext", `${short(this.#at * 1e3)} mm`);
    if (document.activeElement !== this.field || !byId("section-problem").textContent) this.field.value = short(this.#at * 1e3);
    byId("section-problem").textContent = "";
  }

  #readColors() {
    this.colors = { part: rgb("--cut-part"), tool: rgb("--cut-tool") };
  }
}
