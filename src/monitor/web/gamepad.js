/**
 * Gamepads and SpaceMice as hands: sticks move and turn what the hand wishes, at a speed that fits the scene; the force comes back as rumble.
 *
 * | | standard gamepad | six axes (SpaceMouse) |
 * |---|---|---|
 * | across, up | left stick | push |
 * | away, near | left and right trigger | push |
 * | turn | right stick, shoulder buttons | tilt, twist |
 */

import { byId } from "./element.js";
import { add, scale, turnAbout, turned } from "./math.js";

const DEAD = 0.12;
/** At full deflection: the radius of the scene in so many seconds, and rad/s. */
const CROSS_S = 3;
const TURN_RAD_PER_S = 1.2;
/** A slow page must not make a leap. */
const LONGEST_S = 0.1;
const RUMBLE_MS = 120;

export class Gamepads {
  /** @param {import("./hand.js").Hand} hand */
  constructor(hand) {
    this.hand = hand;
    this.before = null;
    this.isActive = false;
    this.rumbledAt = 0;
    addEventListener("gamepadconnected", () => this.#begin());
    // One that was connected before the page was loaded.
    if (navigator.getGamepads?.().some(Boolean)) this.#begin();
  }

  #begin() {
    if (this.before !== null) return;
    this.before = performance.now();
    requestAnimationFrame(() => this.#turn());
  }

  #turn() {
    const now = performance.now();
    const dt_s = Math.min(LONGEST_S, (now - this.before) / 1e3);
    const pads = navigator.getGamepads().filter(Boolean);
    byId("hand-gamepad").textContent = pads[0] ? pads[0].id.replace(/ *\(.*/, "") : "none";
    if (pads.length === 0) {
      this.before = null;
      return;
    }
    this.before = now;
    const [way, turn] = deflection(pads[0]);
    const isActive = [...way, ...turn].some((x) => x !== 0);
    if (isActive && this.hand.canMove) this.#move(way, turn, dt_s);
    // Let go: the hand stays where the tool is.
    if (this.isActive && !isActive) this.hand.rest();
    this.isActive = isActive;
    if (byId("hand-rumble").checked && now - this.rumbledAt > RUMBLE_MS / 2) {
      this.rumbledAt = now;
      const magnitude = this.hand.share;
      pads[0].vibrationActuator?.playEffect("dual-rumble", { duration: RUMBLE_MS, strongMagnitude: magnitude, weakMagnitude: magnitude }).catch(() => {});
    }
    requestAnimationFrame(() => this.#turn());
  }

  #move(way, turn, dt_s) {
    const { camera } = this.hand.view;
    const { right, up, backward } = camera.axes;
    const step = (camera.subject.radius / CROSS_S) * dt_s;
    const world = [right, up, backward];
    const sum = world.reduce((total, axis, n) => add(total, scale(axis, way[n] * step)), [0, 0, 0]);
    const spin = world.reduce((total, axis, n) => turned(turnAbout(axis, turn[n] * TURN_RAD_PER_S * dt_s), total), [0, 0, 0, 1]);
    this.hand.nudge(sum, spin);
  }
}

/** How far a gamepad is pushed and turned, each along right, up and toward the eye, from -1 to 1. @param {Gamepad} pad */
function deflection({ axes, buttons, mapping }) {
  const of = (value) => (Math.abs(value ?? 0) > DEAD ? (value - DEAD * Math.sign(value)) / (1 - DEAD) : 0);
  if (mapping !== "standard" && axes.length >= 6) {
    const [x, y, z, tilt, roll, twist] = axes.map(of);
    return [[x, -z, y], [tilt, -twist, roll]];
  }
  const pressed = (n) => buttons[n]?.value ?? 0;
  const along = of(pressed(7)) - of(pressed(6));
  return [[of(axes[0]), -of(axes[1]), -along], [of(axes[3]), of(axes[2]), pressed(4) - pressed(5)]];
}
