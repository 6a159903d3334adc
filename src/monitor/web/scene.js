/**
 * The 3-D view: parts, clay, the tool where the renderer has it, the hand's own pose as a ghost, contact points, force and torque.
 *
 * It draws when something changed, at most once per frame of the screen. All that is drawn stands in world, in m.
 */

import { OrbitCamera } from "./camera.js";
import { onChange, rgb } from "./colors.js";
import { AXES_SIZE, Draw, MOST_DOTS } from "./draw.js";
import { oncePerFrame } from "./frame.js";
import { add, ceilTo125, cornersOf, cross, isFinite3, length, matrixOfPose, multiply, normalize, scale, subtract, transform } from "./math.js";
import { Splats } from "./splats.js";

const MOST_PIXEL_RATIO = 2;
/** Size of a dot, as a share of the distance between points of the tool. */
const DOT_SHARE = 0.55;
/** Smallest full scales of the arrows, N and N·m: below them a force is noise, not news. */
const LEAST_FORCE_SCALE = 0.5;
const LEAST_TORQUE_SCALE = 0.005;

/** @typedef {import("./math.js").Pose} Pose */
/**
 * @typedef {object} Addition
 * @property {(role: "static"|"tool"|"clay") => ?number[]=} cutOf plane beyond which what has this role is not drawn, as `Draw.cut`
 * @property {(part: Part) => ?{faces: object}=} painted faces with tints of their own, drawn in place of those of a part
 * @property {(draw: Draw, ratio: number) => void=} among draws among the parts; `ratio`: pixels of a CSS pixel
 * @property {(draw: Draw, ratio: number) => void=} over draws over everything but the axes
 * @property {{text: string, at: number[], color: string}[]=} labels what is written over the picture; CSS pixels, custom property
 * @property {(part: Part) => void=} added after another part came, and `cleared` before those of another scene do
 * @property {() => void=} drawn after every picture
 * @property {?object=} film there is one: what looks alike is drawn again
 * @property {() => void=} measured after the box around all parts has changed
 */

/** @typedef {{pose: Pose, role: "static"|"tool", idx: number, mesh: import("./mesh.js").Mesh, voxels: string, pointshell: string, faces: object, lines: object}} Part `voxels`, `pointshell`: where they are asked for */

export class SceneView {
  redraw = oncePerFrame(() => {
    if (this.draw.gl.isContextLost() || this.canvas.clientWidth === 0) return;
    this.#drawAll(false);
    this.onDrawn();
    for (const addition of this.additions) addition.drawn?.();
  });

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {(facts: {grid_m: number, force_n: number, torque_nm: number}) => void} scaled called when a scale of the picture changes
   */
  constructor(canvas, scaled) {
    this.canvas = canvas;
    this.scaled = scaled;
    /** Called with how many points in contact are drawn, and how many there are. @type {(n: number, nAll: number) => void} */
    this.counted = () => {};
    this.nPoints = 0;
    /** Called after every picture. */
    this.onDrawn = () => {};
    this.camera = new OrbitCamera(canvas, () => this.redraw());
    /** @type {Part[]} */
    this.parts = [];
    /** A box that the first view has in it besides the parts, world, m. @type {?{min: number[], max: number[]}} */
    this.alsoSeen = null;
    /** Where the camera stood when all was last fitted into the picture. */
    this.fitted = null;
    this.state = null;
    /** What the last state looks like that was drawn, as text. */
    this.looks = "";
    this.points = new Float32Array(0);
    /** Distance between points of the tool, m. */
    this.pointSpacing = 1e-3;
    this.isSeeThrough = false;
    /** A click takes a point of a part: whatever else a pointer does to the tool is left out meanwhile. */
    this.isPicking = false;
    this.clay = new Splats(() => this.redraw());
    /** Box around all parts and clay, world, m. */
    this.box = this.camera.subject;
    /** What other modules add to the picture. @type {Addition[]} */
    this.additions = [];
    this.draw = new Draw(canvas);
    this.clay.prepare(this.draw.gl);
    this.#readColors();
    this.clear();
    onChange(() => {
      this.#readColors();
      this.redraw();
    });
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.draw.prepare();
      this.clay.prepare(this.draw.gl);
      for (const part of this.parts) this.#upload(part);
      this.redraw();
    });
    new ResizeObserver(() => {
      if (this.fitted) this.fitUntouched();
      this.redraw();
    }).observe(canvas);
    for (const use of ["pointerdown", "wheel", "keydown"]) canvas.addEventListener(use, () => (this.isUsed = true), { capture: true, passive: true });
  }

  /** Takes all parts out, for another scene. */
  clear() {
    for (const drawn of this.parts.flatMap(({ faces, lines }) => [faces, lines])) this.draw.free(drawn);
    this.parts = [];
    this.looks = "";
    this.alsoSeen = null;
    this.fitted = null;
    this.isUsed = false;
    for (const addition of this.additions) addition.cleared?.();
    this.clay.clear();
    this.points = new Float32Array(0);
    this.scales = { grid_m: 0.01, force_n: LEAST_FORCE_SCALE, torque_nm: LEAST_TORQUE_SCALE };
    this.redraw();
  }

  /** @param {{idx: number, role: "static"|"tool", pose: Pose, mesh: import("./mesh.js").Mesh, voxels: string, pointshell: string}} part */
  add(part) {
    this.#upload(part);
    this.parts.push(part);
    this.looks = "";
    this.#measure();
    for (const addition of this.additions) addition.added?.(part);
    this.redraw();
  }

  /** Clay in another shape. @param {import("./splats.js").Samples} samples */
  addClay(samples) {
    const isFirst = !this.clay.samples;
    this.clay.take(samples);
    if (isFirst) {
      this.#measure();
      this.fitUntouched();
    }
    this.redraw();
  }

  /** Shows the newest state: another picture, if it looks different. @param {object} state */
  show(state) {
    this.state = state;
    const { objects, tool_cp, device_cp_world, contact_cf, contacts, points } = state;
    const looks = JSON.stringify([state.state, objects, tool_cp, device_cp_world, contact_cf, contacts > 0, points]);
    if (looks === this.looks && !this.additions.some(({ film }) => film)) return;
    this.looks = looks;
    for (const { idx, p, q } of state.objects ?? []) {
      const part = this.parts.find((part) => part.idx === idx);
      if (part && isFinite3(p)) part.pose = { p, q };
    }
    if (state.points) {
      this.points = relativeDepths(state.points);
      this.nPoints = state.points_of ?? state.points.length;
    }
    if (state.contacts === 0) this.points = new Float32Array(0);
    this.#rescale("force_n", length(state.contact_cf.f), LEAST_FORCE_SCALE);
    this.#rescale("torque_nm", length(state.contact_cf.t), LEAST_TORQUE_SCALE);
    this.redraw();
  }

  /** All of the scene in the picture, arrows back to their first scale. */
  fit() {
    this.scales = { ...this.scales, force_n: LEAST_FORCE_SCALE, torque_nm: LEAST_TORQUE_SCALE };
    this.scaled(this.scales);
    this.#measure();
    this.#fitCamera();
    this.isUsed = false;
  }

  /** All of the scene, unless the user has worked in the view or chosen another one since it was last fitted: what a hand aims at stands still. */
  fitUntouched() {
    const { target, distance } = this.camera;
    if (!this.fitted || (!this.isUsed && this.fitted.target === target && this.fitted.distance === distance)) this.#fitCamera();
  }

  #fitCamera() {
    this.camera.fit();
    const { target, distance } = this.camera;
    this.fitted = { target, distance };
  }

  /** The tool in the middle, near. */
  lookAtTool() {
    const { middle, radius } = this.tool;
    this.camera.lookAt(middle, 7 * radius);
  }

  /** @param {boolean} isSeeThrough whether fixed parts let the tool shine through */
  seeThrough(isSeeThrough) {
    this.isSeeThrough = isSeeThrough;
    this.redraw();
  }

  /** Draws at once and in full; what is drawn can be read from the canvas until the caller returns to the browser. */
  drawNow() {
    this.#drawAll(true);
  }

  /** Where a part stands in the picture. @param {Part} part @returns {Pose} */
  standing(part) {
    return this.#poseOf(part);
  }

  /** Plane beyond which what has this role is not drawn. @param {"static"|"tool"|"clay"} role @returns {?number[]} */
  cutOf(role) {
    return this.additions.map((addition) => addition.cutOf?.(role)).find(Boolean) ?? null;
  }

  /** Middle and radius of the tool where it stands, m. */
  get tool() {
    const part = this.parts.find(({ role }) => role === "tool");
    if (!part) return { middle: this.camera.subject.middle, radius: 0.3 * this.camera.subject.radius };
    const { min, max } = part.mesh;
    return { middle: transform(this.#poseOf(part), scale(add(min, max), 0.5)), radius: length(subtract(max, min)) / 2 };
  }

  #poseOf(part) {
    const shown = part.role === "tool" ? this.state?.tool_cp : null;
    return isFinite3(shown?.p) && isFinite3(shown?.q) ? shown : part.pose;
  }

  /** Box around all parts, for the camera, the grid and the floor. */
  #measure() {
    const min = [Infinity, Infinity, Infinity];
    const max = [-Infinity, -Infinity, -Infinity];
    const corners = this.parts.flatMap((part) => cornersOf(part.mesh).map((corner) => transform(this.#poseOf(part), corner)));
    for (const corner of [...corners, ...this.clay.corners]) {
      corner.forEach((x, axis) => {
        min[axis] = Math.min(min[axis], x);
        max[axis] = Math.max(max[axis], x);
      });
    }
    if (!isFinite3(min)) return;
    this.box = { min, max };
    this.floor = min[2];
    const least = min.map((x, axis) => Math.min(x, this.alsoSeen?.min[axis] ?? x));
    const most = max.map((x, axis) => Math.max(x, this.alsoSeen?.max[axis] ?? x));
    const radius = Math.max(length(subtract(most, least)) / 2, 1e-4);
    this.camera.subject = { min: least, max: most, middle: scale(add(least, most), 0.5), radius };
    this.scales.grid_m = ceilTo125(radius / 8);
    this.scaled(this.scales);
    for (const addition of this.additions) addition.measured?.();
  }

  /** Full scales grow in steps of 1, 2, 5 and never shrink by themselves: an arrow that gets shorter means less force. */
  #rescale(name, size, least) {
    const fitting = Math.max(least, ceilTo125(size));
    if (!Number.isFinite(size) || fitting <= this.scales[name]) return;
    this.scales[name] = fitting;
    this.scaled(this.scales);
  }

  #readColors() {
    const names = ["part", "part-edge", "tool", "tool-edge", "ghost", "point", "force", "torque", "grid", "brush", "axis-x", "axis-y", "axis-z"];
    this.colors = Object.fromEntries(names.map((name) => [name, rgb(`--${name}`)]));
  }

  #upload(part) {
    part.faces = this.draw.faces(part.mesh);
    part.lines = this.draw.lines(part.mesh.edges);
  }

  #drawAll(isInFull) {
    const { draw, canvas, camera, colors, parts } = this;
    const { view } = camera;
    const ratio = Math.min(devicePixelRatio, MOST_PIXEL_RATIO) * this.clay.shareOfPixels(view, this.cutOf("clay"), isInFull);
    const width = Math.round(canvas.clientWidth * ratio);
    const height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const backward = camera.backward;
    const right = normalize(cross([0, 0, 1], backward));
    const projection = camera.projection(width / Math.max(1, height));
    draw.begin(width, height, {
      view,
      projection,
      viewProjection: multiply(projection, view),
      // Half heights of the picture per unit at distance 1.
      stretch: projection[5],
      eye: camera.eye,
      light: normalize(add(add(backward, scale(right, -0.55)), scale(cross(backward, right), 0.8))),
    });

    const statics = parts.filter(({ role }) => role === "static");
    for (const part of parts) {
      if (part.role === "static" && this.isSeeThrough) continue;
      const [face, edge] = part.role === "tool" ? ["tool", "tool-edge"] : ["part", "part-edge"];
      const model = matrixOfPose(this.#poseOf(part));
      draw.cut = this.cutOf(part.role);
      const painted = this.#painted(part);
      if (painted) draw.solid(painted, model, [1, 1, 1]);
      else draw.solid(part, model, colors[face]);
      draw.outline(part, model, colors[edge], 0.75);
    }
    draw.cut = null;
    for (const addition of this.additions) addition.among?.(draw, ratio);
    if (!this.isSeeThrough) this.#drawClay(1);
    this.#drawGround();
    if (this.isSeeThrough) {
      this.#drawClay(0.35);
      for (const part of statics) {
        const model = matrixOfPose(part.pose);
        draw.cut = this.cutOf("static");
        const painted = this.#painted(part);
        draw.veil(painted ?? part, model, painted ? [1, 1, 1] : colors.part, 0.25);
        draw.outline(part, model, colors["part-edge"], 0.6);
      }
      draw.cut = null;
    }
    this.#drawGhost();
    this.#drawPoints(ratio);
    // What follows lies over everything: a force inside of a part is the one to see.
    draw.lay();
    this.#drawBrush();
    this.#drawWrench();
    for (const addition of this.additions) addition.over?.(draw, ratio);
    draw.axes(view, backward, ["axis-x", "axis-y", "axis-z"].map((name) => colors[name]), ratio);
  }

  /** What is drawn in place of the faces of a part, if anything. */
  #painted(part) {
    return this.additions.map((addition) => addition.painted?.(part)).find(Boolean) ?? null;
  }

  #drawClay(opacity) {
    this.draw.cut = this.cutOf("clay");
    this.clay.drawSurface(this.draw, opacity);
    this.draw.cut = null;
    this.clay.drawGrid((...how) => this.draw.use(this.draw.programs.line, ...how), this.colors["part-edge"]);
    this.clay.drawRegion((...how) => this.draw.use(this.draw.programs.line, ...how), this.colors.grid);
  }

  #drawBrush() {
    const { middle } = this.tool;
    const pixels = (this.canvas.clientHeight / 2) * (this.draw.frame.stretch / length(subtract(this.draw.frame.eye, middle)));
    this.clay.drawCurves((...how) => this.draw.use(this.draw.programs.line, ...how), this.colors.brush);
    this.clay.drawBrush((...how) => this.draw.use(this.draw.programs.line, ...how), middle, this.camera.backward, this.colors.brush, pixels);
  }

  #drawGround() {
    const { camera, floor } = this;
    if (floor === undefined) return;
    const [x, y] = camera.subject.middle;
    this.draw.ground([x, y, floor], this.colors.grid, 5 * camera.subject.radius, this.scales.grid_m);
  }

  /** The tool where the hand has it: it leaves the tool as far as the coupling is stretched. */
  #drawGhost() {
    const part = this.parts.find(({ role }) => role === "tool");
    const pose = this.state?.device_cp_world;
    if (!part || !isFinite3(pose?.p) || !isFinite3(pose?.q)) return;
    const { min, max } = part.mesh;
    const corners = [min, max, [min[0], max[1], max[2]], [max[0], min[1], min[2]]];
    const apart = Math.max(...corners.map((corner) => length(subtract(transform(pose, corner), transform(this.#poseOf(part), corner)))));
    const strength = Math.min(1, apart / (0.02 * this.tool.radius));
    if (strength < 0.05) return;
    const model = matrixOfPose(pose);
    this.draw.veil(part, model, this.colors.ghost, 0.22 * strength);
    this.draw.outline(part, model, this.colors.ghost, 0.9 * strength);
  }

  /** Points of the tool: beyond a section plane that cuts the tool there is nothing that they could be on. */
  #drawPoints(ratio) {
    const points = within(this.points, this.cutOf("tool"));
    this.counted(points.length / 4, this.points.length > 0 ? this.nPoints : 0);
    if (points.length === 0) return;
    this.draw.dots(points, this.colors.point, DOT_SHARE * this.pointSpacing, [3 * ratio, 9 * ratio], this.canvas.height);
  }

  /** Force as an arrow, torque as one with two heads along its axis, by the right hand. */
  #drawWrench() {
    const { state, scales, colors } = this;
    if (!state) return;
    const { middle } = this.tool;
    const full = 0.9 * this.camera.subject.radius;
    const { f, t } = state.contact_cf;
    // A contact without force is pale.
    const opacity = state.state === "ENABLED" ? 1 : 0.35;
    if (isFinite3(f)) this.draw.arrow(middle, f, (full * length(f)) / scales.force_n, full, [...colors.force, opacity], 1);
    if (isFinite3(t)) this.draw.arrow(middle, t, (full * length(t)) / scales.torque_nm, full, [...colors.torque, opacity], 2);
  }

  /** Where the names of the axes belong, CSS pixels from the lower left corner of the view. @returns {number[][]} */
  get axisTips() {
    const { view } = this.camera;
    return [0, 1, 2].map((axis) => [0, 1].map((n) => (AXES_SIZE / 2) * (1 + view[axis * 4 + n] * 1.28 * (2 / 3))));
  }
}

/** Points that a plane leaves in the picture. @param {Float32Array} points `[x, y, z, …]` in a row @param {?number[]} cut */
function within(points, cut) {
  if (!cut) return points;
  const isLeft = (n) => cut[0] * points[n] + cut[1] * points[n + 1] + cut[2] * points[n + 2] <= cut[3];
  return points.filter((_, n) => isLeft(n - (n % 4)));
}

/** Points `[x, y, z, depth]` in a row, depths as shares of the deepest. */
function relativeDepths(points) {
  const shown = points.slice(0, MOST_DOTS);
  const deepest = Math.max(1e-9, ...shown.map(([, , , depth]) => depth));
  return new Float32Array(shown.flatMap(([x, y, z, depth]) => [x, y, z, depth / deepest]));
}
