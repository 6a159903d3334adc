/**
 * The surface of clay as its samples describe it: blended from their discs, in light and with occlusion.
 *
 * | pass | into | how often |
 * |---|---|---|
 * | depth of the nearest discs, then normals and colours of those near it, weighted and added | textures | when clay, camera or plane changed |
 * | occlusion | a texture of half the size | as above |
 * | light, with the depth of the surface | textures | as above, and with another look |
 * | what came of it | the picture, among parts and tool | every picture |
 */

import { cutOf } from "./lod.js";
import { multiply } from "./math.js";
import { link } from "./shaders.js";
import { BLENDED, NEAREST, OCCLUSION, SHOWN, SINGLE, lit } from "./splat-shaders.js";

/** Looks in the order of their numbers in the program. */
export const LOOKS = ["lit", "wax", "metal"];
/** What is drawn of the samples, in the order of their numbers in the program: one surface that is blended from discs, or each sample for itself. */
export const FORMS = ["surface", "discs", "sprites", "spheres"];
/** Radius of a single disc, sprite or sphere, in distances between samples: neighbours meet. */
const SINGLE_REACH = 0.5;
/** Radius of a disc in distances between samples: what hides what is behind, and what is blended. Discs overlap, also where samples are not even. */
const HIDES = 0.95;
const BLENDS = 1.5;
/** A disc is at most so many times as large as the mean one. */
const MOST_SPACINGS = 8;
/** Discs so near to the nearest one, in distances between samples, belong to the same surface. */
const SAME = 1;
/** Variance of the low-pass filter of the picture, square pixels, and that of a disc of radius 1: its weight falls as `exp(-3 r²)`. */
const LOW_PASS_PX2 = 0.5;
const DISC_VARIANCE = 1 / 6;
/** How far a place of the surface hides others, as a share of the radius of all samples. */
const OCCLUDES = 0.18;
/** Nodes of samples are drawn that are as far apart in the picture as this at most, pixels; more where it moves and is slow to draw. */
const APART_PX = 1;
const APART_MOVING_PX = 5;

const SOURCES = {
  nearest: NEAREST,
  blended: BLENDED,
  single: SINGLE,
  occlusion: OCCLUSION,
  shown: SHOWN,
  ...Object.fromEntries(LOOKS.flatMap((look, n) => [[look, lit(n, false)], [`${look} coarse`, lit(n, true)]])),
};

export class SplatSurface {
  constructor() {
    /** @type {typeof LOOKS[number]} */
    this.look = LOOKS[0];
    /** @type {typeof FORMS[number]} */
    this.form = FORMS[0];
    /** What layers show, as text. */
    this.made = "";
    /** How many samples, or nodes of them, the layers are made of. */
    this.drawn = 0;
  }

  /** Everything on a graphics card that knows nothing of it. @param {WebGL2RenderingContext} gl */
  prepare(gl) {
    this.gl = gl;
    this.programs = {};
    this.hasFloats = Boolean(gl.getExtension("EXT_color_buffer_float") ?? gl.getExtension("EXT_color_buffer_half_float"));
    this.empty = gl.createVertexArray();
    this.layers = null;
    this.size = [0, 0];
    this.made = "";
  }

  /** Made when it is first used: most of the looks never are. @param {string} name @returns {import("./shaders.js").Program} */
  #program(name) {
    this.programs[name] ??= link(this.gl, SOURCES[name]);
    return this.programs[name];
  }

  /**
   * @param {import("./draw.js").Draw} draw
   * @param {{texture: WebGLTexture, elements: WebGLVertexArrayObject, levels: import("./lod.js").Levels, starts: number[], spacing: number, unit: number, radius: number, corners: number[][],
   *   version: number}} samples corners of triangles in `elements`, those of a level from its start on; `radius` and `corners` (world) of the box around all of them, m
   * @param {Float32Array} model world from their frame
   * @param {number} opacity
   * @param {boolean} isCoarse whether fewer and larger discs do
   * @returns {boolean} whether layers were made anew
   */
  show(draw, samples, model, opacity, isCoarse) {
    const { gl, frame, cut } = draw;
    const { width, height } = gl.canvas;
    const cutOfView = cut ? toView(frame.view, cut) : [0, 0, 0, 1];
    const key = [this.form, this.look, isCoarse, samples.version, width, height, ...frame.viewProjection, ...model, ...cutOfView].join();
    const isChanged = key !== this.made;
    if (isChanged) this.#make([width, height], frame, samples, model, cutOfView, isCoarse);
    this.made = key;
    gl.viewport(0, 0, width, height);
    this.#bound([width, height]);
    const at = this.#over(this.#program("shown"), frame, ["picture", "reached"]);
    gl.uniform1f(at.opacity, opacity);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.SCISSOR_TEST);
    return isChanged;
  }

  /** Leaves alone what is outside of the samples' box in the picture. @param {number[]} size of what is drawn into, pixels */
  #bound([width, height]) {
    const { gl, edges: [left, bottom, right, top] } = this;
    gl.enable(gl.SCISSOR_TEST);
    const [x, y] = [Math.floor(left * width), Math.floor(bottom * height)];
    gl.scissor(x, y, Math.max(0, Math.ceil(right * width) - x), Math.max(0, Math.ceil(top * height) - y));
  }

  #make(size, frame, samples, model, cut, isCoarse) {
    const { gl } = this;
    if (size[0] !== this.size[0] || size[1] !== this.size[1]) this.#allocate(size);
        this.edges = edgesOf(frame, samples);
    this.#target(this.layers.layers, size, gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.bindVertexArray(samples.elements);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, samples.texture);
    const view = multiply(frame.view, model);
    const cuts = cutOf(samples.levels, pixelsIn(frame, view, size, samples.spacing), samples.spacing, isCoarse ? APART_MOVING_PX : APART_PX);
    this.drawn = cuts.flat().reduce((sum, [first, end]) => sum + end - first, 0);
    const discs = ({ program, at }, overlap, lift) => {
      gl.useProgram(program);
      gl.uniformMatrix4fv(at.model, false, view);
      gl.uniformMatrix4fv(at.projection, false, frame.projection);
      gl.uniform4fv(at.cut, cut);
      gl.uniform2f(at.half_px, size[0] / 2, size[1] / 2);
      // Discs of all kinds are scaled ones of the same: so is the filter.
      gl.uniform1f(at.low_pass, (LOW_PASS_PX2 / DISC_VARIANCE) * (overlap / BLENDS) ** 2);
      // Eight bits: discs that overlap must not be more than full.
      gl.uniform1f(at.share, this.hasFloats ? 1 : 1 / 8);
      gl.uniform1i(at.form, FORMS.indexOf(this.form));
      gl.uniform1i(at.samples, 0);
      cuts.forEach((ranges, level) => {
        const wide = 2 ** level;
        gl.uniform1f(at.overlap, wide * overlap);
        gl.uniform1f(at.spacing, samples.spacing);
        gl.uniform1f(at.unit, samples.unit);
        gl.uniform1f(at.lift, wide * lift * samples.spacing);
        for (const [first, end] of ranges) gl.drawElements(gl.TRIANGLES, 3 * (end - first), gl.UNSIGNED_INT, 12 * (samples.starts[level] + first));
      });
    };
    gl.disable(gl.BLEND);
    if (this.form === "surface") {
      gl.colorMask(false, false, false, false);
      discs(this.#program("nearest"), HIDES, 0);
      gl.colorMask(true, true, true, true);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE);
      gl.depthMask(false);
      discs(this.#program("blended"), BLENDS, SAME);
      gl.depthMask(true);
    } else {
      discs(this.#program("single"), SINGLE_REACH, 0);
    }

    gl.disable(gl.BLEND);
    if (!isCoarse) this.#occlude(frame, samples);
    this.#light(frame, isCoarse);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.SCISSOR_TEST);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  #occlude(frame, { radius }) {
    const { gl, size } = this;
    const halves = size.map((side) => Math.ceil(side / 2));
    this.#target(this.layers.half, halves, gl.COLOR_BUFFER_BIT);
    const at = this.#over(this.#program("occlusion"), frame, ["depths", "normals"]);
    gl.uniform1f(at.reach, OCCLUDES * radius);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  #light(frame, isCoarse) {
    const { gl, size } = this;
    this.#target(this.layers.whole, size, gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const at = this.#over(this.#program(isCoarse ? `${this.look} coarse` : this.look), frame, ["depths", "normals", "colors", "occlusion"]);
    // Means of 2 × 2, four of them beside each other, around the pixel.
    gl.uniform2f(at.blur_uv, 4 / size[0], 4 / size[1]);
    gl.uniform2f(at.size_px, ...size);
    gl.uniform3f(at.up, frame.view[8], frame.view[9], frame.view[10]);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** What follows is drawn into empty textures, as far as samples reach in the picture. */
  #target(framebuffer, size, cleared) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(0, 0, ...size);
    gl.disable(gl.SCISSOR_TEST);
    gl.clear(cleared);
    this.#bound(size);
  }

  /** Takes a program that looks at all of some layers. @returns {object} the places of its parameters */
  #over({ program, at }, frame, names) {
    const { gl } = this;
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.projection, false, frame.projection);
    names.forEach((name, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this.layers[name]);
      gl.uniform1i(at[name], unit);
    });
    gl.activeTexture(gl.TEXTURE0);
    gl.bindVertexArray(this.empty);
    return at;
  }

  #allocate(size) {
    const { gl } = this;
    for (const name of this.layers ? ["depths", "normals", "colors", "occlusion", "picture", "reached"] : []) gl.deleteTexture(this.layers[name]);
    for (const name of this.layers ? ["layers", "half", "whole"] : []) gl.deleteFramebuffer(this.layers[name]);
    const texture = (format, [width, height], filter) => {
      const made = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, made);
      gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
      for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
      for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
      return made;
    };
    const target = (attached) => {
      const made = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, made);
      for (const [place, texture] of attached) gl.framebufferTexture2D(gl.FRAMEBUFFER, place, gl.TEXTURE_2D, texture, 0);
      gl.drawBuffers(attached.map(([place]) => place).filter((place) => place !== gl.DEPTH_ATTACHMENT));
      return made;
    };
    const sums = this.hasFloats ? gl.RGBA16F : gl.RGBA8;
    const depths = texture(gl.DEPTH_COMPONENT24, size, gl.NEAREST);
    const normals = texture(sums, size, gl.NEAREST);
    const colors = texture(sums, size, gl.NEAREST);
    const picture = texture(gl.RGBA8, size, gl.NEAREST);
    const reached = texture(gl.DEPTH_COMPONENT24, size, gl.NEAREST);
    const occlusion = texture(gl.RG8, size.map((side) => Math.ceil(side / 2)), gl.LINEAR);
    const layers = target([[gl.COLOR_ATTACHMENT0, normals], [gl.COLOR_ATTACHMENT1, colors], [gl.DEPTH_ATTACHMENT, depths]]);
    const half = target([[gl.COLOR_ATTACHMENT0, occlusion]]);
    const whole = target([[gl.COLOR_ATTACHMENT0, picture], [gl.DEPTH_ATTACHMENT, reached]]);
    this.layers = { depths, normals, colors, occlusion, picture, reached, layers, half, whole };
    this.size = size;
  }
}

/** Left, lower, right and upper edge of all discs, shares of the picture; all of it where some are behind the eye. */
function edgesOf({ viewProjection: m, projection }, { corners, spacing }) {
  const row = (n, [x, y, z]) => m[n] * x + m[4 + n] * y + m[8 + n] * z + m[12 + n];
  const nearest = Math.min(...corners.map((corner) => row(3, corner)));
  if (!(nearest > 0)) return [0, 0, 1, 1];
  const margin = (MOST_SPACINGS * BLENDS * spacing * projection[5]) / nearest;
  const along = (n) => corners.map((corner) => 0.5 + (0.5 * row(n, corner)) / row(3, corner));
  const [xs, ys] = [along(0), along(1)];
  const bound = (share) => Math.min(1, Math.max(0, share));
  return [Math.min(...xs) - margin, Math.min(...ys) - margin, Math.max(...xs) + margin, Math.max(...ys) + margin].map(bound);
}

/**
 * How many pixels a metre has at the nearest place of a ball in the frame of the samples; 0 where all of its discs are beside the picture.
 * @param {Float32Array} view the camera's frame from that of the samples
 */
function pixelsIn({ projection }, view, size, spacing) {
  const [px, py] = [projection[0], projection[5]];
  const [lx, ly] = [Math.hypot(px, 1), Math.hypot(py, 1)];
  return ([x, y, z], radius) => {
    const row = (n) => view[n] * x + view[4 + n] * y + view[8 + n] * z + view[12 + n];
    const far = -row(2);
    const reach = radius + MOST_SPACINGS * BLENDS * spacing;
    const isBeside = far < -reach || Math.abs(row(0)) * px - far > reach * lx || Math.abs(row(1)) * py - far > reach * ly;
    return isBeside ? 0 : (py * size[1]) / 2 / Math.max(far - radius, spacing);
  };
}

/** A plane `[n, d]` of world in the frame of the camera. @param {Float32Array} view @param {number[]} cut */
function toView(view, [x, y, z, d]) {
  const turned = [0, 1, 2].map((row) => view[row] * x + view[4 + row] * y + view[8 + row] * z);
  return [...turned, d + turned.reduce((sum, part, row) => sum + part * view[12 + row], 0)];
}
