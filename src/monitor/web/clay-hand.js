/**
 * Clay worked with the cursor: the tool hovers over the surface where the cursor is, and goes into it while the button is down.
 *
 * | | does |
 * |---|---|
 * | cursor over the clay | the tool comes there, a little above |
 * | button down, finger, pen | it touches the clay, as deep as the strength says; what a craft holds is held until the button is up |
 * | wheel over the clay | size of the brush; with Ctrl the view zooms |
 * | [ and ] | strength of the press; a pen has its own |
 */

import { byId, say, words } from "./element.js";
import { ours } from "./hand.js";
import { add, dot, length, rotate, scale, subtract, transform } from "./math.js";
import { clayAt } from "./pick.js";
import { fixed } from "./units.js";

/** Above the clay, as a share of the tool's radius, while no button is down. */
const HOVER = 0.6;
/** Depth of a press at strength 1, as a share of the tool's radius. */
const PRESS = 0.5;
/** What is held is held from a light touch on. */
const TOUCH = 0.1;
const [LEAST, MOST, STEP] = [0.125, 4, Math.SQRT2];
/** A hold begins when the tool is this near to its place, in radii, or after so long. */
const THERE = 0.3;
const LATEST_MS = 600;
/** From this near, in radii, and from this much in front of it (cosine) the tool goes straight to its place; how often that is looked at. */
const NEAR = 3;
const IN_FRONT = 0.97;
const LOOK_MS = 30;
const BRUSH_STEP = 1.1;

export class ClayHand {
  /**
   * @param {import("./link.js").Link} link
   * @param {import("./scene.js").SceneView} view
   * @param {import("./hand.js").Hand} hand
   * @param {import("./clay.js").Clay} clay
   */
  constructor(link, view, hand, clay) {
    Object.assign(this, { link, view, hand, clay });
    this.strength = 1;
    /** What the button does. @type {?{id: number, at: number[], isHeld: boolean, begun: number, front: number}} */
    this.press = null;
    this.#listen();
    this.#tell();
  }

  get #canWork() {
    return Boolean(!this.view.isPicking && this.clay.facts && this.view.clay.samples && this.hand.canMove && this.hand.hasForce);
  }

  #listen() {
    const { canvas } = this.view;
    const first = { capture: true };
    canvas.addEventListener("pointerdown", (event) => this.#begin(event) && ours(event), first);
    canvas.addEventListener("pointermove", (event) => {
      if (this.press?.id === event.pointerId) {
        ours(event);
        this.#work(event);
      } else if (!event.buttons && event.pointerType !== "touch" && this.#canWork) this.#hover(event);
    }, first);
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      canvas.addEventListener(end, ({ pointerId }) => this.press?.id === pointerId && this.#end(), first);
    }
    addEventListener("blur", () => this.press && this.#end());
    canvas.addEventListener("wheel", (event) => {
      if (event.ctrlKey || !this.#canWork || !this.view.clay.brush || !this.#under(event)) return;
      ours(event);
      this.#resize(event.deltaY < 0 ? BRUSH_STEP : 1 / BRUSH_STEP);
    }, { capture: true, passive: false });
    addEventListener("keydown", (event) => {
      if (!"[]".includes(event.key) || !this.#canWork || event.target.matches?.("input:not([type=range]):not([type=checkbox]), select")) return;
      this.strength = Math.min(MOST, Math.max(LEAST, this.strength * (event.key === "]" ? STEP : 1 / STEP)));
      this.#tell();
    });
  }

  #tell() {
    byId("clay-strength").textContent = fixed(this.strength, 2);
  }

  /** What the cursor is on. @returns {?{point: number[], normal: number[]}} world */
  #under({ clientX, clientY }) {
    return clayAt(this.view, clientX, clientY);
  }

  /** Puts the tool over a point of the clay, its surface as many radii above it. */
  #place({ point, normal }, above, at) {
    const { radius_m, middle } = this.#tool;
    const { q } = this.hand.tool;
    const center = add(point, scale(normal, radius_m * (1 + above)));
    this.goal = { center, middle, q, radius_m };
    this.#approach(at);
    return center;
  }

  /** Goes to the goal; from elsewhere first in front of it, as the eye sees it: there is no clay in between. */
  #approach(at = undefined) {
    const { goal, hand } = this;
    if (!goal || !hand.canMove) return;
    const { center, middle, q, radius_m } = goal;
    const away = subtract(transform(hand.tool, middle), center);
    const far = length(away);
    const { backward } = this.view.camera;
    const isInFront = far < NEAR * radius_m || dot(away, backward) > IN_FRONT * far;
    const next = isInFront ? center : add(center, scale(backward, far));
    hand.move({ p: subtract(next, rotate(q, middle)), q }, at);
    if (isInFront) this.goal = null;
    else if (!this.isOnWay) {
      this.isOnWay = true;
      setTimeout(() => {
        this.isOnWay = false;
        this.#approach();
      }, LOOK_MS);
    }
  }

  /** Radius of the largest ball in the tool's box, and the middle of that, in its own frame. */
  get #tool() {
    const part = this.view.parts.find(({ role }) => role === "tool");
    if (!part) return { radius_m: 1e-3, middle: [0, 0, 0] };
    const { min, max } = part.mesh;
    return { radius_m: Math.min(...subtract(max, min)) / 2, middle: scale(add(min, max), 0.5) };
  }

  #hover(event) {
    const under = this.#under(event);
    this.view.canvas.classList.toggle("is-on-clay", Boolean(under));
    if (under) this.#place(under, HOVER, event.timeStamp);
  }

  #begin(event) {
    if (this.press || event.button !== 0 || event.shiftKey || event.ctrlKey || !this.#canWork) return false;
    const under = this.#under(event);
    if (!under) return false;
    this.view.canvas.setPointerCapture(event.pointerId);
    this.view.canvas.focus({ preventScroll: true });
    this.press = { id: event.pointerId, at: [event.clientX, event.clientY], isHeld: this.clay.isHeldCraft, begun: performance.now(), front: this.#front(under) };
    if (this.press.isHeld) this.#hold(this.#place(under, -TOUCH, event.timeStamp));
    else this.#work(event);
    return true;
  }

  /** Holds what the craft holds, once the tool is there. */
  #hold(center) {
    const { press } = this;
    const wait = () => {
      if (this.press !== press) return;
      const { radius_m, middle } = this.#tool;
      const away = length(subtract(transform(this.hand.tool, middle), center));
      if (away < THERE * radius_m || (!this.goal && performance.now() - press.begun > LATEST_MS)) {
        press.holds = true;
        this.clay.hold();
      } else requestAnimationFrame(wait);
    };
    wait();
  }

  #work(event) {
    const { press } = this;
    if (press.isHeld) {
      // In the plane of the picture, from where the hold began.
      const [dx, dy] = [event.clientX - press.at[0], event.clientY - press.at[1]];
      press.at = [event.clientX, event.clientY];
      const { camera } = this.view;
      const { right, up } = camera.axes;
      const pixel = camera.pixelAt(this.hand.wish.p);
      if (press.holds) this.hand.nudge(add(scale(right, dx * pixel), scale(up, -dy * pixel)), undefined, event.timeStamp);
      return;
    }
    const under = this.#under(event);
    const pressure = event.pointerType === "pen" && event.pressure > 0 ? 2 * event.pressure : 1;
    if (!under) return;
    press.front = Math.max(press.front, this.#front(under));
    this.#place(under, -PRESS * this.strength * pressure, event.timeStamp);
  }

  /** How far toward the eye a point of the clay is, m. */
  #front({ point }) {
    return dot(point, this.view.camera.backward);
  }

  #end() {
    const { press } = this;
    [this.press, this.goal] = [null, null];
    if (press.holds) this.clay.letGo();
    // Toward the eye, in front of all that was touched as it was before: where a stroke is undone the clay comes back, and must not meet the tool.
    const { radius_m, middle } = this.#tool;
    const { backward } = this.view.camera;
    const { p, q } = this.hand.tool;
    const way = press.front + (1 + HOVER) * radius_m - dot(transform(this.hand.tool, middle), backward);
    this.hand.move({ p: add(p, scale(backward, Math.max(way, 2 * radius_m))), q });
  }

  async #resize(factor) {
    const { brush_m, brush_range_m: [least, most] } = this.clay.facts;
    try {
      await this.link.send("clay_take", { brush_m: Math.min(most, Math.max(least, brush_m * factor)) });
      await this.clay.refresh();
    } catch (error) {
      say(words(error));
    }
  }
}
