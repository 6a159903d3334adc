/**
 * A section plane across x, y or z: what lies beyond it is left out of the picture, and what it cuts through has a flat, hatched face, as on
 * a drawing. Buttons, a slider, a field and a handle in the picture move it. Clay is cut too, but has no face: its samples lie on the surface only.
 */

import { onChange, rgb } from "./colors.js";
import { byId } from "./element.js";
import { add, dot, matrixOfPose, scale, subtract } from "./math.js";
import { readNumber, refusal } from "./number-field.js";
import { project } from "./pick.js";
import { short } from "./units.js";

const STEPS = 1000;
/** How far the slider goes beyond the parts, as a share of their size. */
const BEYOND = 0.1;
/** Between two lines of the hatching, CSS pixels. */
const HATCH = 9;
/** Half of the handle, and how near to the border of the picture it stands, CSS pixels. */
const HANDLE = 26;
const BORDER = 60;
/** A handle that is shorter than this in the picture points at the eye: no drag could say how far, CSS pixels. */
const LEAST_HANDLE = 12;

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
    /** While the handle is dragged: its place then, and how far along the normal it was taken, m. @type {?{from: number[], grabbed: number}} */
    this.drag = null;
    this.#readColors();
    onChange(() => this.#readColors());
    this.slider = byId("section-slider");
    this.field = byId("section-place");
    byId("section").onclick = () => this.#turn(!this.isOn);
    for (const button of document.querySelectorAll("#section-box [data-axis]")) button.onclick = () => this.#cutAlong(Number(button.dataset.axis));
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
    this.handle = byId("section-handle");
    this.handle.onpointerdown = (event) => this.#take(event);
    this.handle.onpointermove = (event) => this.#drag(event);
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) this.handle.addEventListener(end, () => this.#release());
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

  /** The border of the plane, and the handle. */
  drawn() {
    const { normal } = this;
    const corners = this.isOn ? this.#corners.map((corner) => project(this.view, corner)) : [];
    const isWhole = corners.length > 0 && corners.every(Boolean);
    byId("section-border").setAttribute("points", isWhole ? corners.map((at) => at.join()).join(" ") : "");
    const place = this.isOn ? this.#handlePlace() : null;
    const ends = place ? [-1, 1].map((side) => project(this.view, add(place, scale(normal, side * HANDLE * this.view.camera.pixelAt(place))))) : [];
    const [from, to] = ends;
    const isShown = Boolean(from && to) && Math.hypot(to[0] - from[0], to[1] - from[1]) > LEAST_HANDLE;
    this.handle.classList.toggle("is-shown", isShown);
    if (!isShown) return;
    const angle = (Math.atan2(to[1] - from[1], to[0] - from[0]) * 180) / Math.PI;
    const size = Math.hypot(to[0] - from[0], to[1] - from[1]) / (2 * HANDLE);
    this.handle.setAttribute("transform", `translate(${(from[0] + to[0]) / 2} ${(from[1] + to[1]) / 2}) rotate(${angle}) scale(${size} 1)`);
  }

  /** Another scene comes. */
  cleared() {
    this.place = null;
    if (this.isOn) this.#turn(false);
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

  /** Along the axis. */
  get normal() {
    return [0, 1, 2].map((axis) => (axis === this.axis ? 1 : 0));
  }

  /** Corners of the plane around the parts, in turn. */
  get #corners() {
    const { min, max } = this.view.box;
    const [a, b] = [0, 1, 2].filter((axis) => axis !== this.axis);
    return [[min[a], min[b]], [max[a], min[b]], [max[a], max[b]], [min[a], max[b]]].map((sides) => {
      const corner = [0, 0, 0];
      [corner[a], corner[b], corner[this.axis]] = [...sides, this.#at];
      return corner;
    });
  }

  /** Where the handle stands, world: at the corner that is seen farthest down and to the right; in the middle of a picture that has none. */
  #handlePlace() {
    const { normal, view } = this;
    if (this.drag) return add(this.drag.from, scale(normal, this.#at - this.drag.from[this.axis]));
    const { clientWidth: width, clientHeight: height } = view.canvas;
    const seen = this.#corners
      .map((corner) => ({ corner, at: project(view, corner) }))
      .filter(({ at }) => at && at[0] > BORDER && at[1] > BORDER && at[0] < width - BORDER && at[1] < height - BORDER)
      .sort((one, other) => other.at[0] + other.at[1] - one.at[0] - one.at[1]);
    if (seen.length > 0) return seen[0].corner;
    const ray = view.camera.rayThrough([width / 2, height / 2]);
    const far = (this.#at - view.camera.eye[this.axis]) / ray[this.axis];
    return far > 0 && Number.isFinite(far) ? add(view.camera.eye, scale(ray, far)) : null;
  }

  /** How far along the line of the handle the cursor is: where the line of sight passes nearest to it, m. */
  #along(event, from) {
    const { camera, canvas } = this.view;
    const { left, top } = canvas.getBoundingClientRect();
    const ray = camera.rayThrough([event.clientX - left, event.clientY - top]);
    const way = subtract(camera.eye, from);
    const slant = ray[this.axis];
    // Beyond the point of the picture where all lines along the normal end there is nothing nearer than the far end.
    if (slant * way[this.axis] <= dot(way, ray)) return slant > 0 ? Infinity : -Infinity;
    return (way[this.axis] - slant * dot(way, ray)) / (1 - slant * slant);
  }

  #take(event) {
    if (event.button !== 0 || this.drag) return;
    const from = this.#handlePlace();
    this.drag = { from, grabbed: this.#along(event, from) };
    this.handle.setPointerCapture(event.pointerId);
    this.handle.classList.add("is-held");
    event.preventDefault();
  }

  #drag(event) {
    if (!this.drag) return;
    const { from, grabbed } = this.drag;
    const [low, high] = this.#range;
    const place = from[this.axis] + this.#along(event, from) - grabbed;
    this.#move(Math.min(high, Math.max(low, place)));
  }

  #release() {
    this.drag = null;
    this.handle.classList.remove("is-held");
    this.view.redraw();
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
    for (const button of document.querySelectorAll("#section-box [data-axis]")) button.setAttribute("aria-pressed", String(Number(button.dataset.axis) === axis));
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
    // To a thousandth of the way: what is finer is noise of the middle.
    const step = 10 ** Math.floor(Math.log10(high - low) - 3);
    if (document.activeElement !== this.field || !byId("section-problem").textContent) this.field.value = short(Math.round(this.#at / step) * step * 1e3);
    byId("section-problem").textContent = "";
  }

  #readColors() {
    this.colors = { part: rgb("--cut-part"), tool: rgb("--cut-tool") };
  }
}
