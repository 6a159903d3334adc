/**
 * What the 3-D view is drawn with: faces, lines, dots, a ground with a grid, arrows and axes, all in world, in m.
 *
 * Knows nothing of scenes: the caller says what stands where, and in which colour.
 */

import { add, dot, matrixAlong, matrixOfPose, multiply, normalize, scale } from "./math.js";
import { compile } from "./shaders.js";
import { cone, rod } from "./shapes.js";

/** Dots in a picture at most. */
export const MOST_DOTS = 512;
/** Side of the square in which the axes are drawn, CSS pixels. */
export const AXES_SIZE = 92;
const IDENTITY = matrixOfPose({ p: [0, 0, 0], q: [0, 0, 0, 1] });

/** @typedef {{vao: WebGLVertexArrayObject, n: number, buffers: WebGLBuffer[], tints: WebGLBuffer=}} Drawn positions on the graphics card */
/** @typedef {{view: Float32Array, projection: Float32Array, viewProjection: Float32Array, stretch: number, eye: number[], light: number[]}} Frame from where a picture is taken */

export class Draw {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true, stencil: true, powerPreference: "high-performance" });
    if (!this.gl) throw new Error("this browser has no WebGL 2");
    /** What follows is not drawn where `n · p > d`: `[nx, ny, nz, d]`, world, m; null: all is. @type {?number[]} */
    this.cut = null;
    this.prepare();
  }

  /** All that a graphics card needs to know that knows nothing, or nothing any more. */
  prepare() {
    const { gl } = this;
    this.programs = compile(gl);
    // Faces without tints of their own.
    gl.vertexAttrib3f(2, 1, 1, 1);
    this.rod = this.faces(rod());
    this.cone = this.faces(cone());
    this.plane = this.lines(new Float32Array([-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0]));
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, MOST_DOTS * 16, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 4, gl.FLOAT, false, 0, 0);
    this.dotted = { vao, buffer };
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  /** @returns {Drawn} triangles */
  faces({ positions, normals }) {
    const { gl } = this;
    const drawn = this.lines(positions);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, normals, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 4, gl.BYTE, true, 0, 0);
    drawn.buffers.push(buffer);
    return drawn;
  }

  /** Gives faces a tint at every corner, or other ones. @param {Drawn} drawn @param {Uint8Array} tints [4 × corners] */
  tint(drawn, tints) {
    const { gl } = this;
    if (!drawn.tints) {
      drawn.tints = gl.createBuffer();
      drawn.buffers.push(drawn.tints);
      gl.bindVertexArray(drawn.vao);
      gl.bindBuffer(gl.ARRAY_BUFFER, drawn.tints);
      gl.enableVertexAttribArray(2);
      gl.vertexAttribPointer(2, 3, gl.UNSIGNED_BYTE, true, 4, 0);
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, drawn.tints);
    gl.bufferData(gl.ARRAY_BUFFER, tints, gl.DYNAMIC_DRAW);
  }

  /** @param {Float32Array} positions @returns {Drawn} ends of lines */
  lines(positions) {
    const { gl } = this;
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, positions, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    return { vao, n: positions.length / 3, buffers: [buffer] };
  }

  /** Takes it off the graphics card. @param {Drawn} drawn */
  free({ vao, buffers }) {
    this.gl.deleteVertexArray(vao);
    for (const buffer of buffers) this.gl.deleteBuffer(buffer);
  }

  /** A picture begins. @param {number} width @param {number} height pixels @param {Frame} frame */
  begin(width, height, frame) {
    const { gl } = this;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.frame = frame;
  }

  /** What follows lies over everything before. */
  lay() {
    this.gl.clear(this.gl.DEPTH_BUFFER_BIT);
  }

  /** Takes a program. @returns {object} the places of its parameters */
  use(kind, model, color, opacity) {
    const { gl, frame } = this;
    const { program, at } = (this.cut && kind.cut) || kind;
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.view_projection, false, frame.viewProjection);
    if (at.model) gl.uniformMatrix4fv(at.model, false, model);
    gl.uniform4f(at.color, ...color, opacity);
    if (at.eye) gl.uniform3fv(at.eye, frame.eye);
    if (at.light) gl.uniform3fv(at.light, frame.light);
    if (at.cut) gl.uniform4fv(at.cut, this.cut);
    return at;
  }

  /** @param {{faces: Drawn}} part */
  solid({ faces }, model, color, opacity = 1) {
    const { gl } = this;
    this.use(this.programs.surface, model, color, opacity);
    // Lines on an edge win over the faces that meet there.
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    gl.bindVertexArray(faces.vao);
    gl.drawArrays(gl.TRIANGLES, 0, faces.n);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  /**
   * The face at which the plane `cut` goes through a closed part, flat and hatched.
   * @param {{faces: Drawn}} part @param {number[]} color @param {number} slant of the hatching, 1 or −1 @param {number} step of it, pixels
   * @param {number[]} near a place that the face is near to @param {number} reach from there to all of it at least, m
   */
  cap(part, model, color, slant, step, near, reach) {
    const { gl, cut } = this;
    gl.clear(gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.ALWAYS, 0, 255);
    // Beyond the plane a line of sight meets as many faces from within as from without, unless it passes the plane inside of the part.
    gl.stencilOpSeparate(gl.BACK, gl.KEEP, gl.KEEP, gl.INCR_WRAP);
    gl.stencilOpSeparate(gl.FRONT, gl.KEEP, gl.KEEP, gl.DECR_WRAP);
    gl.disable(gl.DEPTH_TEST);
    gl.colorMask(false, false, false, false);
    this.solid(part, model, color);
    gl.colorMask(true, true, true, true);
    gl.enable(gl.DEPTH_TEST);
    gl.stencilFunc(gl.NOTEQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP);
    const normal = cut.slice(0, 3);
    const origin = add(near, scale(normal, cut[3] - dot(normal, near)));
    this.cut = null;
    const at = this.use(this.programs.cap, matrixAlong(origin, normal, reach, 1), color, 1);
    gl.uniform1f(at.slant, slant);
    gl.uniform1f(at.step_px, step);
    gl.bindVertexArray(this.plane.vao);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    this.cut = cut;
    gl.disable(gl.STENCIL_TEST);
  }

  /** @param {{lines: Drawn}} part */
  outline({ lines }, model, color, opacity) {
    if (lines.n === 0) return;
    const { gl } = this;
    this.use(this.programs.line, model, color, opacity);
    gl.bindVertexArray(lines.vao);
    gl.drawArrays(gl.LINES, 0, lines.n);
  }

  /** Only the nearest faces, blended: depth first, then colour. @param {{faces: Drawn}} part */
  veil(part, model, color, opacity) {
    const { gl } = this;
    gl.colorMask(false, false, false, false);
    this.solid(part, model, color);
    gl.colorMask(true, true, true, true);
    this.solid(part, model, color, opacity);
  }

  /** A grid around a place. @param {number[]} middle @param {number} reach m @param {number} step between lines, m */
  ground(middle, color, reach, step) {
    const { gl } = this;
    const at = this.use(this.programs.grid, matrixOfPose({ p: middle, q: [0, 0, 0, 1] }), color, 1);
    gl.uniform1f(at.reach, reach);
    gl.uniform1f(at.step_m, step);
    gl.depthMask(false);
    gl.bindVertexArray(this.plane.vao);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.depthMask(true);
  }

  /**
   * Dots that shine through everything.
   * @param {Float32Array} dots `[x, y, z, strength]` in a row, at most MOST_DOTS
   * @param {number} size m @param {number[]} bounds least and most pixels @param {number} height of the picture, pixels
   */
  dots(dots, color, size, bounds, height) {
    const { gl } = this;
    const at = this.use(this.programs.point, IDENTITY, color, 1);
    gl.uniform1f(at.size_m, size);
    gl.uniform1f(at.pixels, (height / 2) * this.frame.stretch);
    gl.uniform2f(at.bounds, ...bounds);
    gl.bindVertexArray(this.dotted.vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.dotted.buffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, dots);
    gl.disable(gl.DEPTH_TEST);
    gl.drawArrays(gl.POINTS, 0, dots.length / 4);
    gl.enable(gl.DEPTH_TEST);
  }

  /** @param {number} size length @param {number} full length at full scale, which sets the thickness @param {number} heads */
  arrow(origin, direction, size, full, [r, g, b, opacity], heads) {
    // Signs, not things: brighter than what light makes of a part.
    const color = scale([r, g, b], 1.3);
    const head = Math.min(0.13 * full, 0.45 * size);
    if (size < 0.01 * full) return;
    const width = Math.min(1, size / (0.3 * full)) * 0.02 * full;
    const unit = normalize(direction);
    const at = (along) => add(origin, scale(unit, along));
    this.solid({ faces: this.rod }, matrixAlong(origin, unit, width, size - 0.9 * head), color, opacity);
    for (let n = 0; n < heads; n += 1) {
      this.solid({ faces: this.cone }, matrixAlong(at(size - head * (1 + 0.75 * n)), unit, 2.6 * width, head), color, opacity);
    }
  }

  /**
   * The directions of world in the lower left corner: the last that a picture gets.
   * @param {Float32Array} view of the camera @param {number[]} backward @param {number[][]} colors @param {number} ratio of pixels
   */
  axes(view, backward, colors, ratio) {
    const { gl } = this;
    const side = Math.round(AXES_SIZE * ratio);
    gl.viewport(0, 0, side, side);
    const turned = new Float32Array(view);
    turned.set([0, 0, 0], 12);
    // Parallel projection of a ball of radius 1.5 around the origin.
    const flat = new Float32Array([2 / 3, 0, 0, 0, 0, 2 / 3, 0, 0, 0, 0, -0.5, 0, 0, 0, 0, 1]);
    this.frame = { ...this.frame, viewProjection: multiply(flat, turned), eye: scale(backward, 10) };
    colors.forEach((color, axis) => {
      const unit = [0, 0, 0].map((_, n) => (n === axis ? 1 : 0));
      this.solid({ faces: this.rod }, matrixAlong([0, 0, 0], unit, 0.045, 0.75), color);
      this.solid({ faces: this.cone }, matrixAlong(scale(unit, 0.75), unit, 0.12, 0.25), color);
    });
  }
}
