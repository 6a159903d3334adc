/**
 * Measuring on parts and clay: two points give a distance, a third one an angle at the second. Points move with their parts; one of clay stays
 * where the surface was.
 *
 * A button switches it on; while it is on, a click or a tap takes a point, and drags turn the view as ever. Escape clears.
 */

import { onChange, rgb } from "./colors.js";
import { byId, element } from "./element.js";
import { add, dot, length, matrixAlong, normalize, scale, subtract } from "./math.js";
import { pickAt, placeOf, project } from "./pick.js";
import { fixed } from "./units.js";

/** A pointer that moved further than this between down and up was a drag, CSS pixels. */
const CLICK_PX = 5;
/** Widths of lines and dots, CSS pixels. */
const LINE_PX = 2;
const DOT_PX = 9;
const ASK = ["Click a first point", "Click a second point", "A third point gives an angle"];

export class Measure {
  /** @param {import("./scene.js").SceneView} view */
  constructor(view) {
    this.view = view;
    this.isOn = false;
    /** @type {import("./pick.js").Pick[]} at most three */
    this.picks = [];
    /** The last click met nothing. */
    this.isMissed = false;
    /** What is written in the picture: text, and its place, CSS pixels. @type {{text: string, at: number[], color: string}[]} */
    this.labels = [];
    this.color = rgb("--measure");
    onChange(() => (this.color = rgb("--measure")));
    byId("measure").onclick = () => this.#turn(!this.isOn);
    byId("measure-clear").onclick = () => this.clear();
    addEventListener("keydown", ({ key }) => key === "Escape" && this.clear());
    this.#listen();
    view.additions.push(this);
  }

  clear() {
    this.picks = [];
    this.isMissed = false;
    this.view.redraw();
    this.drawn();
  }

  /** Lines and dots. @param {import("./draw.js").Draw} draw @param {number} ratio */
  over(draw, ratio) {
    const places = this.#places();
    if (places.length === 0) return;
    const { height } = this.view.canvas;
    const eye = draw.frame.eye;
    for (const [a, b] of this.#pairs(places)) {
      const middle = scale(add(a, b), 0.5);
      const perPixel = length(subtract(eye, middle)) / (draw.frame.stretch * 0.5 * height);
      const side = subtract(b, a);
      draw.solid({ faces: draw.rod }, matrixAlong(a, side, 0.5 * LINE_PX * ratio * perPixel, length(side)), this.color);
    }
    const dots = new Float32Array(places.flatMap((place) => [...place, 1]));
    draw.dots(dots, this.color, 0, [DOT_PX * ratio, DOT_PX * ratio], height);
  }

  /** Numbers follow the points. */
  drawn() {
    const places = this.#places();
    const pairs = this.#pairs(places);
    const distances = pairs.map(([a, b]) => ({ text: `${fixed(length(subtract(b, a)) * 1e3, 3)} mm`, place: scale(add(a, b), 0.5) }));
    const angle = places.length === 3 ? angleAt(places) : null;
    const said = [...distances, ...(angle === null ? [] : [{ text: `${fixed(angle, 2)}°`, place: places[1] }])];
    this.labels = said.flatMap(({ text, place }) => {
      const at = project(this.view, place);
      return at ? [{ text, at, color: "--measure" }] : [];
    });
    byId("measure-labels").replaceChildren(
      ...this.labels.map(({ text, at }) => {
        const label = element("li", {}, text);
        Object.assign(label.style, { left: `${at[0]}px`, top: `${at[1]}px` });
        return label;
      }),
    );
    if (!this.isOn) return;
    const way = pairs.length === 1 ? ` (${axes(pairs[0])} mm)` : "";
    const text = this.isMissed ? "There is nothing at that place" : said.length > 0 ? said.map(({ text }) => text).join(", ") + way : ASK[places.length];
    if (byId("measure-answer").textContent !== text) byId("measure-answer").textContent = text;
    byId("measure-clear").disabled = places.length === 0;
  }

  /** Points of what is still there, world. */
  #places() {
    this.picks = this.picks.filter(({ part }) => (part ? this.view.parts.includes(part) : this.view.clay.samples));
    return this.picks.map((pick) => placeOf(this.view, pick));
  }

  #pairs(places) {
    return places.slice(1).map((place, n) => [places[n], place]);
  }

  #turn(isOn) {
    this.isOn = isOn;
    // A click on the tool is to be a point of it, whatever else the pointer does to the tool.
    this.view.isPicking = isOn;
    byId("measure").setAttribute("aria-pressed", String(isOn));
    byId("measure-box").hidden = !isOn;
    this.view.canvas.classList.toggle("is-picking", isOn);
    this.clear();
  }

  #listen() {
    const { canvas } = this.view;
    /** @type {?{id: number, at: number[]}} the one finger or button that is down */
    let down = null;
    canvas.addEventListener("pointerdown", ({ pointerId: id, clientX, clientY, isPrimary, button }) => {
      down = this.isOn && isPrimary && button === 0 ? { id, at: [clientX, clientY] } : null;
    });
    canvas.addEventListener("pointerup", ({ pointerId, clientX, clientY }) => {
      if (!down || down.id !== pointerId || Math.hypot(clientX - down.at[0], clientY - down.at[1]) > CLICK_PX) return;
      down = null;
      this.#take(clientX, clientY);
    });
  }

  #take(x, y) {
    const pick = pickAt(this.view, x, y);
    this.isMissed = !pick;
    this.view.redraw();
    if (!pick) return;
    this.picks = this.picks.length === 3 ? [pick] : [...this.picks, pick];
  }
}

/** Angle at the second of three points, degrees. */
function angleAt([a, b, c]) {
  const cos = dot(normalize(subtract(a, b)), normalize(subtract(c, b)));
  return (Math.acos(Math.max(-1, Math.min(1, cos))) * 180) / Math.PI;
}

const axes = ([a, b]) => {
  const [x, y, z] = subtract(b, a).map((side) => fixed(Math.abs(side) * 1e3, 3));
  return `x ${x}, y ${y}, z ${z}`;
};
