/**
 * The hand of a simulated arm, moved from this page: a drag of the tool in the view, keys, a gamepad.
 *
 * ```text
 *  drag, wheel, second finger ─┐
 *  keys on the view            ├─► wish ─► hand (WebSocket) ─► loop ─► state ─► tool, band, force, sound, rumble
 *  gamepad, SpaceMouse         ┘
 * ```
 * What is asked for is a pose of the tool; what the tool does is up to the loop, which stops it at the parts. One request is under way at a time,
 * with the newest wish.
 */

import { byId, say, words } from "./element.js";
import { Gamepads } from "./gamepad.js";
import { add, angleBetween, isFinite3, length, rotate, scale, squared, subtract, transform, transformBack, turnAbout, turned } from "./math.js";
import { count, fixed } from "./units.js";

const AXES = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };
/** Where the handles for one axis begin and end, from the middle of the tool, and how near to that they appear, CSS pixels. */
const HANDLE = [28, 72];
const NEAR = 80;
const LEAST_HANDLE = 12;
/** A tool that is smaller in the picture than this can still be taken, CSS pixels. */
const LEAST_TARGET = 14;
/** Turn for a pixel, rad; way for a notch of the wheel and for a key, in CSS pixels of the picture at the tool. */
const TURN = 0.008;
const WHEEL = 0.15;
const KEY = 6;
const KEY_TURN = Math.PI / 36;
/** Poses of which the latency is shown, and those whose use by a tick is waited for. */
const MEASURED = 500;
const AWAITED = 8;
const IS_TOUCH = matchMedia("(pointer: coarse)");
/** Of a sound at the largest force: frequency, Hz, and loudness. */
const TONE_HZ = 110;
const LOUDNESS = 0.15;

export class Hand {
  /** @param {import("./link.js").Link} link @param {import("./scene.js").SceneView} view */
  constructor(link, view) {
    this.link = link;
    this.view = view;
    this.canvas = view.canvas;
    /** The scene's hand; null: a person holds the arm, or no hand does. @type {?{path: boolean}} */
    this.facts = null;
    /** Newest wish, and where the tool is. @type {?import("./math.js").Pose} */
    this.wish = null;
    this.tool = null;
    /** What a finger or a button does. */
    this.drag = null;
    this.force_n = 0;
    this.limit_n = 5;
    /** From input to tick, of the newest poses, ms. @type {number[]} */
    this.latencies = [];
    /** By the number of the order: ms from input to the server. @type {Map<number, number>} */
    this.awaited = new Map();
    /** The newest order that a tick has used. @type {?{order: number, waited_us: number}} */
    this.used = null;
    this.gamepads = new Gamepads(this);
    byId("hand-straighten").onclick = ({ timeStamp }) => this.straighten(timeStamp);
    byId("hand-restart").onclick = () => this.#order("restart_hand");
    byId("hand-reset").onclick = () => this.#order("reset");
    byId("hand-sound").onchange = ({ target }) => (target.checked ? this.#openSound() : this.#closeSound());
  }

  /** Another scene is rendered. @param {{hand: ?object, clay: boolean}} scene */
  learn({ hand, clay, scene_idx: scene }) {
    this.facts = hand ?? null;
    this.scene = scene;
    [this.wish, this.drag] = [null, null];
    [this.latencies, this.used] = [[], null];
    this.awaited.clear();
    byId("hand-latency").textContent = "–";
    byId("hand-box").hidden = !hand;
    byId("hand-reset").hidden = clay;
    byId("hand-restart").disabled = !hand?.path;
    byId("hand-path").textContent = hand?.path ? "" : "No path: the hand waits where the tool begins.";
    this.#draw();
  }

  /** The parameters of the scene. @param {{name: string, value: number}[]} all */
  learnLimits(all) {
    this.limit_n = all.find(({ name }) => name === "limit_force_n")?.value || this.limit_n;
  }

  /** @param {object} state the newest */
  show(state) {
    this.tool = isFinite3(state.tool_cp?.p) ? { p: state.tool_cp.p, q: state.tool_cp.q } : null;
    this.force_n = isFinite3(state.servo_cf?.f) ? length(state.servo_cf.f) : 0;
    this.newestScene = state.scene_idx;
    const hadForce = this.hasForce;
    this.hasForce = state.state === "ENABLED";
    // What pulled the tool is over; the next enable begins anew.
    if ((hadForce && !this.hasForce) || state.scene_idx !== this.scene) this.#letGo();
    this.used = state.hand ?? null;
    this.#measure();
    if (this.gain) this.gain.gain.setTargetAtTime(LOUDNESS * this.share, this.sound.currentTime, 0.02);
    this.#draw();
  }

  /** The force on the hand as a share of the largest one. */
  get share() {
    return Math.min(1, this.force_n / this.limit_n);
  }

  get canMove() {
    return Boolean(this.facts && this.tool && this.link.isOpen);
  }

  /** Middle of the tool in its own frame. */
  get #middle() {
    const part = this.view.parts.find(({ role }) => role === "tool");
    return part ? scale(add(part.mesh.min, part.mesh.max), 0.5) : [0, 0, 0];
  }

  /**
   * Asks the hand to hold the tool at a pose.
   * @param {import("./math.js").Pose} pose @param {number=} at when the input was made that asks for it, ms of this page
   */
  move(pose, at = performance.now()) {
    this.wish = pose;
    this.wishedAt = at;
    this.isDue = true;
    this.#send();
  }

  /**
   * Moves and turns the wish, about the middle of the tool.
   * @param {number[]} way m @param {number[]=} turn quaternion @param {number=} at as in `move`
   */
  nudge(way, turn = [0, 0, 0, 1], at = performance.now()) {
    if (!this.canMove) return;
    const pose = this.wish ?? this.tool;
    const pivot = transform(pose, this.#middle);
    const q = turned(turn, pose.q);
    this.move({ p: add(subtract(pivot, rotate(q, this.#middle)), way), q }, at);
  }

  /** Turns the wish so that the axes of the tool lie along those of the world, by the shortest way. @param {number=} at as in `move` */
  straighten(at) {
    if (!this.canMove) return;
    const { q } = this.wish ?? this.tool;
    const [x, y, z, w] = q;
    this.nudge([0, 0, 0], turned(squared(q), [-x, -y, -z, w]), at);
  }

  /** The hand holds the tool where it is. */
  rest() {
    if (this.canMove) this.move(this.tool);
    this.wish = null;
    this.#draw();
  }

  async #send() {
    if (this.isSending || !this.isDue) return;
    [this.isSending, this.isDue] = [true, false];
    const { p, q } = this.wish ?? this.tool;
    const { wishedAt, scene } = this;
    const begun = performance.now();
    try {
      const { order } = await this.link.send("hand", { pose: { p, q }, scene_idx: scene });
      // Half of the way to the server and back is the way there.
      this.awaited.set(order, begun - wishedAt + (performance.now() - begun) / 2);
      if (this.awaited.size > AWAITED) this.awaited.delete(this.awaited.keys().next().value);
      this.#measure();
    } catch (error) {
      this.isDue = false;
      // Of a scene that is gone: this page has not learnt of the next one yet.
      if (this.newestScene === scene) say(words(error));
    }
    this.isSending = false;
    this.#send();
  }

  /** From input to tick, of the order that a tick has used; without force nothing is moved. */
  #measure() {
    const { used, awaited } = this;
    if (!used || !awaited.has(used.order) || !this.hasForce) return;
    this.latencies = [...this.latencies, awaited.get(used.order) + used.waited_us / 1e3].slice(-MEASURED);
    awaited.delete(used.order);
    const sorted = this.latencies.toSorted((a, b) => a - b);
    const at = (share) => fixed(sorted[Math.ceil(share * sorted.length) - 1], 1);
    byId("hand-latency").textContent = `${at(0.5)} ms, 99 % within ${at(0.99)} ms (${count(sorted.length)} ${sorted.length === 1 ? "pose" : "poses"})`;
  }

  async #order(what) {
    this.wish = null;
    this.drag = null;
    try {
      await this.link.send(what, {}, 60_000);
    } catch (error) {
      say(words(error));
    }
  }

  /** Begins to listen to the view, before its camera does; what listened before goes first. */
  listen() {
    const { canvas } = this;
    // Before the camera, which gets what is not for the tool.
    const first = { capture: true };
    canvas.addEventListener("pointerdown", (event) => this.#begin(event) && ours(event), first);
    canvas.addEventListener("pointermove", (event) => {
      if (this.drag?.fingers.has(event.pointerId)) {
        this.#follow(event);
        ours(event);
      } else if (!event.buttons) {
        this.isNear = this.canMove && this.#away(this.#at(event)) < NEAR;
        canvas.classList.toggle("is-on-tool", this.canMove && this.#isOnTool(event));
        this.#draw();
      }
    }, first);
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(end, (event) => this.#end(event), first);
    canvas.addEventListener("wheel", (event) => {
      if (!this.drag) return;
      ours(event);
      const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1);
      this.#along(-pixels * WHEEL, event.timeStamp);
    }, { capture: true, passive: false });
    canvas.addEventListener("keydown", (event) => this.#key(event) && ours(event), first);
    for (const handle of document.querySelectorAll("#hand-overlay [data-axis]")) {
      handle.addEventListener("pointerdown", (event) => this.canMove && event.button === 0 && this.#take(event, { axis: AXES[handle.dataset.axis] }));
    }
    addEventListener("blur", () => this.drag && this.#end());
    // Without the page no button comes up again. Nothing waits for the answer to an order that is under way.
    addEventListener("pagehide", () => this.drag && this.tool && this.link.send("hand", { pose: this.tool, scene_idx: this.scene }).catch(() => {}));
  }

  #at({ clientX, clientY }) {
    const { left, top } = this.canvas.getBoundingClientRect();
    return [clientX - left, clientY - top];
  }

  /** Whether a pointer is on the tool: its box, or what of it a finger can hit. */
  #isOnTool(event) {
    const at = this.#at(event);
    return this.#away(at) < LEAST_TARGET || this.#hit(at) !== null;
  }

  /** Distance of a place in the picture from the middle of the tool, CSS pixels. */
  #away(at) {
    const middle = this.view.camera.toScreen(transform(this.tool, this.#middle));
    return Math.hypot(at[0] - middle[0], at[1] - middle[1]);
  }

  /** Where a ray meets the box of the tool; null where it does not. */
  #hit(at) {
    const part = this.view.parts.find(({ role }) => role === "tool");
    if (!part) return null;
    const { camera } = this.view;
    const ray = camera.rayThrough(at);
    const origin = transformBack(this.tool, camera.eye);
    const direction = subtract(transformBack(this.tool, add(camera.eye, ray)), origin);
    let [near, far] = [0, Infinity];
    for (let axis = 0; axis < 3; axis += 1) {
      const ends = [part.mesh.min, part.mesh.max].map((corner) => (corner[axis] - origin[axis]) / (direction[axis] || 1e-12));
      [near, far] = [Math.max(near, Math.min(...ends)), Math.min(far, Math.max(...ends))];
    }
    return near <= far ? add(camera.eye, scale(ray, near)) : null;
  }

  #begin(event) {
    if (!this.canMove) return false;
    const { drag } = this;
    if (drag && event.pointerType === "touch") {
      // The second finger: turn about the line of sight, and near or far.
      drag.fingers.set(event.pointerId, this.#at(event));
      this.canvas.setPointerCapture(event.pointerId);
      return true;
    }
    if (drag || event.button === 1 || event.shiftKey || this.view.isPicking || !this.#isOnTool(event)) return false;
    this.#take(event, { isTurn: event.button === 2 || event.ctrlKey });
    return true;
  }

  #take(event, how) {
    if (!this.hasForce) {
      say("No force flows: the hand waits. Enable first.");
      return;
    }
    const at = this.#at(event);
    const grabbed = this.#hit(at) ?? transform(this.tool, this.#middle);
    this.drag = { isTurn: false, axis: null, ...how, fingers: new Map([[event.pointerId, at]]), local: transformBack(this.tool, grabbed), from: this.tool };
    this.wish = { ...this.tool };
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    document.body.classList.add("has-hand");
  }

  #follow(event) {
    const { drag } = this;
    const before = drag.fingers.get(event.pointerId);
    const now = this.#at(event);
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const { right, up, backward } = this.view.camera.axes;
    const pixel = this.view.camera.pixelAt(transform(this.wish ?? this.tool, drag.local));
    if (drag.fingers.size > 1) {
      const [other] = [...drag.fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const line = (at) => [Math.atan2(other[1] - at[1], other[0] - at[0]), Math.hypot(other[0] - at[0], other[1] - at[1])];
      const [[angle, spread], [angleBefore, spreadBefore]] = [line(now), line(before)];
      const angleChange = Math.atan2(Math.sin(angle - angleBefore), Math.cos(angle - angleBefore));
      this.nudge(scale(backward, (spread - spreadBefore) * pixel), turnAbout(backward, -angleChange), event.timeStamp);
    } else if (drag.isTurn) {
      this.nudge([0, 0, 0], turned(turnAbout(up, dx * TURN), turnAbout(right, dy * TURN)), event.timeStamp);
    } else if (drag.axis) {
      const from = transform(this.wish ?? this.tool, this.#middle);
      const step = 20 * pixel;
      const [ends, begins] = [add(from, scale(drag.axis, step)), from].map((point) => this.view.camera.toScreen(point));
      const way = [ends[0] - begins[0], ends[1] - begins[1]];
      const size = way[0] ** 2 + way[1] ** 2;
      // An axis that points at the eye has no way in the picture.
      if (size > 1) this.nudge(scale(drag.axis, (step * (dx * way[0] + dy * way[1])) / size), undefined, event.timeStamp);
    } else {
      this.nudge(add(scale(right, dx * pixel), scale(up, -dy * pixel)), undefined, event.timeStamp);
    }
    drag.fingers.set(event.pointerId, now);
    this.#draw();
  }

  #end(event) {
    const { drag } = this;
    if (!drag || (event && !drag.fingers.delete(event.pointerId))) return;
    if (event && drag.fingers.size > 0) return;
    this.#letGo();
    this.rest();
  }

  #letGo() {
    this.drag = null;
    this.wish = null;
    document.body.classList.remove("has-hand");
  }

  /** Moves the wish toward the eye, by so many pixels of the picture. */
  #along(pixels, at) {
    const pose = this.wish ?? this.tool;
    this.nudge(scale(this.view.camera.backward, pixels * this.view.camera.pixelAt(pose.p)), undefined, at);
  }

  #key({ key, ctrlKey, metaKey, altKey, shiftKey, timeStamp }) {
    if (ctrlKey || metaKey || altKey || !this.canMove) return false;
    const letter = key.toLowerCase();
    if (this.drag && letter in AXES) {
      this.drag.axis = this.drag.axis === AXES[letter] ? null : AXES[letter];
      return true;
    }
    if (this.drag && letter === "r") {
      this.drag.isTurn = !this.drag.isTurn;
      return true;
    }
    if (letter === "l") {
      this.straighten(timeStamp);
      return true;
    }
    const { right, up, backward } = this.view.camera.axes;
    const ways = { a: scale(right, -1), d: right, w: up, s: scale(up, -1), q: backward, e: scale(backward, -1) };
    const turns = { a: scale(up, -1), d: up, w: scale(right, -1), s: right, q: backward, e: scale(backward, -1) };
    if (!(letter in ways)) return false;
    if (shiftKey) this.nudge([0, 0, 0], turnAbout(turns[letter], KEY_TURN), timeStamp);
    else this.nudge(scale(ways[letter], KEY * this.view.camera.pixelAt(this.tool.p)), undefined, timeStamp);
    return true;
  }

  /** The band from the tool to the wish, and the handles. */
  #draw() {
    const overlay = byId("hand-overlay");
    // A finger does not come near without touching.
    const isShown = this.canMove && (this.drag || this.isNear || IS_TOUCH.matches);
    overlay.classList.toggle("is-shown", Boolean(isShown));
    const band = byId("hand-band");
    const label = byId("hand-force");
    const { camera } = this.view;
    const hasBand = Boolean(this.drag && this.wish && this.tool);
    band.style.display = label.style.display = hasBand ? "" : "none";
    if (hasBand) {
      const [from, to] = [this.tool, this.wish].map((pose) => camera.toScreen(transform(pose, this.drag.local)));
      set(band, { x1: from[0], y1: from[1], x2: to[0], y2: to[1], "stroke-width": 1.5 + 4 * this.share });
      set(label, { x: to[0] + 14, y: to[1] - 10 });
      const [now, before] = [this.tool, this.drag.from].map((pose) => transform(pose, this.#middle));
      const [way, turn] = [length(subtract(now, before)), angleBetween(this.tool.q, this.drag.from.q)];
      label.textContent = `${fixed(this.force_n, 2)} N  ${fixed(way * 1e3, 1)} mm  ${fixed((turn * 180) / Math.PI, 0)}°`;
    }
    if (!this.canMove) return;
    const from = transform(this.tool, this.#middle);
    for (const handle of overlay.querySelectorAll("[data-axis]")) {
      const [start, end] = HANDLE.map((pixels) => camera.toScreen(add(from, scale(AXES[handle.dataset.axis], pixels * camera.pixelAt(from)))));
      set(handle, { x1: start[0], y1: start[1], x2: end[0], y2: end[1] });
      // One that points at the eye would lie over the tool, and has no way in the picture.
      handle.style.display = Math.hypot(end[0] - start[0], end[1] - start[1]) < LEAST_HANDLE ? "none" : "";
    }
  }

  #openSound() {
    this.sound = new AudioContext();
    this.gain = this.sound.createGain();
    this.gain.gain.value = 0;
    const tone = new OscillatorNode(this.sound, { type: "triangle", frequency: TONE_HZ });
    tone.connect(this.gain).connect(this.sound.destination);
    tone.start();
  }

  #closeSound() {
    this.sound?.close();
    this.sound = this.gain = null;
  }
}

/** An event that is for the hand: neither the camera nor the browser gets it. @param {Event} event */
export function ours(event) {
  event.stopImmediatePropagation();
  event.preventDefault();
}

function set(shape, attributes) {
  for (const [name, value] of Object.entries(attributes)) shape.setAttribute(name, value);
}
