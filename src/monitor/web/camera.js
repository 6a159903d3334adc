/**
 * A camera that orbits a target, z up, steered by mouse, touch and keyboard.
 *
 * | | mouse | touch | keys on the view |
 * |---|---|---|---|
 * | orbit | drag | one finger | arrows |
 * | pan | right drag, shift + drag | two fingers | shift + arrows |
 * | zoom | wheel | pinch | + and − |
 * | fit | double click | double tap | 0 |
 */

import { add, cross, dot, length, lookAt, normalize, perspective, scale, subtract } from "./math.js";

const VIEW_ANGLE = (32 * Math.PI) / 180;
/** Room around what is fitted, for tools and legend. */
const FIT_MARGIN = 1.15;
const MOST_TILT = Math.PI / 2 - 0.001;
const KEY_TURN = Math.PI / 24;
const KEY_PAN = 0.08;
const KEY_ZOOM = 1.2;

/** Directions from the target to the eye: [turn about z, tilt over the ground], rad. */
const SIDES = {
  corner: [-1.05, 0.5],
  front: [-Math.PI / 2, 0],
  side: [0, 0],
  top: [-Math.PI / 2, MOST_TILT],
};

export class OrbitCamera {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {() => void} moved called after every change
   */
  constructor(canvas, moved) {
    this.canvas = canvas;
    this.moved = moved;
    [this.turn, this.tilt] = SIDES.corner;
    this.target = [0, 0, 0];
    this.distance = 0.3;
    /** Box that `fit` shows, with its middle and the radius of the ball around it, m. */
    this.subject = { min: [-0.06, -0.06, -0.06], max: [0.06, 0.06, 0.06], middle: [0, 0, 0], radius: 0.1 };
    /** @type {Map<number, number[]>} fingers and buttons that are down, in CSS pixels */
    this.pointers = new Map();
    this.#listen();
  }

  /** Unit vector from the target to the eye. */
  get backward() {
    const flat = Math.cos(this.tilt);
    return [flat * Math.cos(this.turn), flat * Math.sin(this.turn), Math.sin(this.tilt)];
  }

  /** Unit vectors to the right, up, and from the target to the eye. */
  get axes() {
    const { backward } = this;
    const right = normalize(cross([0, 0, 1], backward));
    return { right, up: cross(backward, right), backward };
  }

  /** Length at a point that is one CSS pixel of the picture, m. */
  pixelAt(point) {
    return (2 * dot(subtract(this.eye, point), this.backward) * Math.tan(VIEW_ANGLE / 2)) / Math.max(1, this.canvas.clientHeight);
  }

  /** Where a point is in the picture, CSS pixels from the upper left corner of the canvas. */
  toScreen(point) {
    const { right, up } = this.axes;
    const offset = subtract(point, this.target);
    const pixel = this.pixelAt(point);
    return [this.canvas.clientWidth / 2 + dot(offset, right) / pixel, this.canvas.clientHeight / 2 - dot(offset, up) / pixel];
  }

  /** Unit vector from the eye through a place in the picture. @param {number[]} at CSS pixels, as `toScreen` gives them */
  rayThrough([x, y]) {
    const { right, up, backward } = this.axes;
    const slope = (2 * Math.tan(VIEW_ANGLE / 2)) / Math.max(1, this.canvas.clientHeight);
    const across = scale(right, (x - this.canvas.clientWidth / 2) * slope);
    return normalize(subtract(add(across, scale(up, (this.canvas.clientHeight / 2 - y) * slope)), backward));
  }

  get eye() {
    return add(this.target, scale(this.backward, this.distance));
  }

  get view() {
    return lookAt(this.eye, this.target, [0, 0, 1]);
  }

  /** @param {number} aspect width over height */
  projection(aspect) {
    const reach = this.distance + length(subtract(this.subject.middle, this.target)) + 3 * this.subject.radius;
    return perspective(VIEW_ANGLE, aspect, Math.max(this.distance / 50, reach / 20_000), 2 * reach);
  }

  /** Shows all of the subject, from the same side. */
  fit() {
    const aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
    const { min, max, middle } = this.subject;
    const backward = this.backward;
    const right = normalize(cross([0, 0, 1], backward));
    const up = cross(backward, right);
    const slope = Math.tan(VIEW_ANGLE / 2);
    this.target = middle;
    this.distance = 0;
    for (let corner = 0; corner < 8; corner += 1) {
      const point = [0, 1, 2].map((axis) => (corner & (1 << axis) ? max : min)[axis]);
      const offset = subtract(point, middle);
      const across = Math.max(Math.abs(dot(offset, right)) / aspect, Math.abs(dot(offset, up)));
      this.distance = Math.max(this.distance, dot(offset, backward) + (FIT_MARGIN * across) / slope);
    }
    this.moved();
  }

  /** Looks from one of the named sides. @param {keyof SIDES} side */
  lookFrom(side) {
    [this.turn, this.tilt] = SIDES[side];
    this.moved();
  }

  /** Puts a point in the middle, the eye at a distance. */
  lookAt(point, distance) {
    this.target = point;
    this.distance = distance;
    this.moved();
  }

  orbit(turn, tilt) {
    this.turn += turn;
    this.tilt = Math.max(-MOST_TILT, Math.min(MOST_TILT, this.tilt + tilt));
    this.moved();
  }

  /** Moves the target by shares of the picture's height. */
  pan(right, up) {
    const x = normalize(cross([0, 0, 1], this.backward));
    const y = cross(this.backward, x);
    const height = 2 * this.distance * Math.tan(VIEW_ANGLE / 2);
    this.target = add(this.target, add(scale(x, right * height), scale(y, up * height)));
    this.moved();
  }

  zoom(factor) {
    const { radius } = this.subject;
    this.distance = Math.max(radius / 500, Math.min(50 * radius, this.distance * factor));
    this.moved();
  }

  #listen() {
    const { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      canvas.addEventListener(end, ({ pointerId }) => this.pointers.delete(pointerId));
    }
    canvas.addEventListener("pointermove", (event) => this.#drag(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", () => this.fit());
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1);
        this.zoom(Math.exp(Math.max(-300, Math.min(300, pixels)) * 0.0015));
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (event) => {
      if (this.#key(event)) event.preventDefault();
    });
  }

  #drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const height = this.canvas.clientHeight;
    if (this.pointers.size === 1) {
      if (event.buttons & 6 || event.shiftKey) this.pan(-dx / height, dy / height);
      else this.orbit((-dx / height) * Math.PI, (dy / height) * Math.PI);
    } else if (this.pointers.size === 2) {
      const [other] = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const spread = (at) => Math.max(1, Math.hypot(at[0] - other[0], at[1] - other[1]));
      this.zoom(spread(before) / spread(now));
      // Both fingers report, each half of the way.
      this.pan(-dx / 2 / height, dy / 2 / height);
    }
    this.pointers.set(event.pointerId, now);
  }

  /** @param {KeyboardEvent} event @returns {boolean} whether the key was ours */
  #key({ key, shiftKey, ctrlKey, metaKey, altKey }) {
    if (ctrlKey || metaKey || altKey) return false;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (key in arrows) {
      const [x, y] = arrows[key];
      if (shiftKey) this.pan(x * KEY_PAN, y * KEY_PAN);
      else this.orbit(x * KEY_TURN, y * KEY_TURN);
    } else if (key === "+" || key === "=") this.zoom(1 / KEY_ZOOM);
    else if (key === "-") this.zoom(KEY_ZOOM);
    else if (key === "0" || key === "f") this.fit();
    else return false;
    return true;
  }
}
