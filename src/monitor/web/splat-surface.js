/**
 * The surface of clay as its samples describe it: blended from their discs, in light and with occlusion.
 *
 * | pass | into | how often |
 * |---|---|---|
 * | depth of the nearest discs, then normals and colours of those near it, weighted and added | textures | when clay, camera or plane changed |
 * | occlusion | a texture of half the size | as above |
 * | light, with the depth of the surface | the picture, among parts and tool | every picture |
 *
 * Where the first two take long, textures are of half the size as long as something changes.
 */

import { multiply } from "./math.js";
import { link } from "./shaders.js";
import { BLENDED, LIT, NEAREST, OCCLUSION } from "./splat-shaders.js";

/** Looks in the order of their numbers in the program. */
export const LOOKS = ["lit", "wax", "metal"];
/** Radius of a disc in distances between samples: what hides what is behind, and what is blended. Discs overlap, also where samples are not even. */
const HIDES = 0.95;
const BLENDS = 1.5;
/** A disc is at most so many times as large as the mean one. */
const MOST_SPACINGS = 8;
/** Discs so near to the nearest one, in distances between samples, belong to the same surface. */
const SAME = 1;
/** A disc has at least this radius, pixels. */
const LEAST_PX = 0.75;
/** How far a place of the surface hides others, as a share of the radius of all samples. */
const OCCLUDES = 0.18;
/** Layers that take longer than this are made smaller, until nothing has changed for a while. */
const SLOW_MS = 60;
const STILL_MS = 200;

export class SplatSurface {
  /** @param {() => void} redraw called when there is a finer picture of what stands still */
  constructor(redraw) {
    this.redraw = redraw;
    /** @type {typeof LOOKS[number]} */
    this.look = LOOKS[0];
    /** How long layers of full size took, ms, as far as that is known. */
    this.took_ms = 0;
    /** What layers show, as text; `isCoarse`: of half the size. */
    this.made = { key: "", isCoarse: false };
    this.changedAt = -Infinity;
  }

  /** Everything on a graphics card that knows nothing of it. @param {WebGL2RenderingContext} gl */
  prepare(gl) {
    this.gl = gl;
    this.programs = Object.fromEntries(Object.entries({ nearest: NEAREST, blended: BLENDED, occlusion: OCCLUSION, lit: LIT }).map(([name, source]) => [name, link(gl, source)]));
    this.hasFloats = Boolean(gl.getExtension("EXT_color_buffer_float") ?? gl.getExtension("EXT_color_buffer_half_float"));
    this.empty = gl.createVertexArray();
    this.layers = null;
    this.size = [0, 0];
    this.made.key = "";
  }

  /**
   * @param {import("./draw.js").Draw} draw
   * @param {{texture: WebGLTexture, n: number, spacing: number, unit: number, radius: number, corners: number[][], version: number}} samples `radius` and `corners`
   *   (world) of the box around all of them, m
   * @param {Float32Array} model world from their frame
   * @param {number} opacity
   */
  show(draw, samples, model, opacity) {
    const { gl, frame, cut } = draw;
    const { width, height } = gl.canvas;
    const cutOfView = cut ? toView(frame.view, cut) : [0, 0, 0, 1];
    const key = [samples.version, width, height, ...frame.viewProjection, ...model, ...cutOfView].join();
    const now = performance.now();
    const isChanged = key !== this.made.key;
    if (isChanged) this.changedAt = now;
    const isCoarse = this.took_ms > SLOW_MS && now - this.changedAt < STILL_MS;
    if (isChanged || (this.made.isCoarse && !isCoarse)) {
      this.#make(isCoarse ? [width / 2, height / 2].map(Math.ceil) : [width, height], frame, samples, model, cutOfView);
      this.made = { key, isCoarse };
      if (!isCoarse) this.#time(now);
      else setTimeout(this.redraw, STILL_MS);
    }
    this.#light(frame, width, height, opacity);
    gl.disable(gl.SCISSOR_TEST);
  }

  /** Leaves alone what is outside of the samples' box in the picture. @param {number[]} size of what is drawn into, pixels */
  #bound([width, height]) {
    const { gl, edges: [left, bottom, right, top] } = this;
    gl.enable(gl.SCISSOR_TEST);
    const [x, y] = [Math.floor(left * width), Math.floor(bottom * height)];
    gl.scissor(x, y, Math.max(0, Math.ceil(right * width) - x), Math.max(0, Math.ceil(top * height) - y));
  }

  /** How long the layers take, which are begun now: the next picture waits for them. */
  #time(begun) {
    requestAnimationFrame(() => {
      this.took_ms = (this.took_ms + performance.now() - begun) / 2;
    });
  }

  #make(size, frame, samples, model, cut) {
    const { gl } = this;
    if (size[0] !== this.size[0] || size[1] !== this.size[1]) this.#allocate(size);
    const { layers, half } = this.layers;
    this.edges = edgesOf(frame, samples);
    gl.bindFramebuffer(gl.FRAMEBUFFER, layers);
    gl.viewport(0, 0, ...size);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.bindVertexArray(this.empty);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, samples.texture);
    const view = multiply(frame.view, model);
    const discs = ({ program, at }, overlap, lift) => {
      gl.useProgram(program);
      gl.uniformMatrix4fv(at.model, false, view);
      gl.uniformMatrix4fv(at.projection, false, frame.projection);
      gl.uniform4fv(at.cut, cut);
      gl.uniform1f(at.overlap, overlap);
      gl.uniform1f(at.spacing, samples.spacing);
      gl.uniform1f(at.unit, samples.unit);
      gl.uniform1f(at.least, (2 * LEAST_PX * overlap) / (size[1] * frame.projection[5]));
      gl.uniform1f(at.lift, lift * samples.spacing);
      // Eight bits: discs that overlap must not be more than full.
      gl.uniform1f(at.share, this.hasFloats ? 1 : 1 / 8);
      gl.uniform1i(at.samples, 0);
      gl.drawArrays(gl.TRIANGLES, 0, 3 * samples.n);
    };
    gl.disable(gl.BLEND);
    gl.colorMask(false, false, false, false);
    discs(this.programs.nearest, HIDES, 0);
    gl.colorMask(true, true, true, true);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    gl.depthMask(false);
    discs(this.programs.blended, BLENDS, SAME);
    gl.depthMask(true);

    gl.disable(gl.BLEND);
    gl.bindFramebuffer(gl.FRAMEBUFFER, half);
    const halves = size.map((side) => Math.ceil(side / 2));
    gl.viewport(0, 0, ...halves);
    gl.clear(gl.COLOR_BUFFER_BIT);
    this.#bound(halves);
    const at = this.#over(this.programs.occlusion, frame);
    gl.uniform1f(at.reach, OCCLUDES * samples.radius);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.SCISSOR_TEST);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  #light(frame, width, height, opacity) {
    const { gl, size } = this;
    gl.viewport(0, 0, width, height);
    this.#bound([width, height]);
    const at = this.#over(this.programs.lit, frame);
    gl.uniform2f(at.step_uv, 1 / size[0], 1 / size[1]);
    // Means of 2 × 2, four of them beside each other, around the pixel.
    gl.uniform2f(at.blur_uv, 4 / size[0], 4 / size[1]);
    gl.uniform3f(at.up, frame.view[8], frame.view[9], frame.view[10]);
    gl.uniform1f(at.opacity, opacity);
    gl.uniform1i(at.look, LOOKS.indexOf(this.look));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Takes a program that looks at all of the layers. @returns {object} the places of its parameters */
  #over({ program, at }, frame) {
    const { gl } = this;
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.projection, false, frame.projection);
    ["depths", "normals", "colors", "occlusion"].forEach((name, unit) => {
      if (!at[name]) return;
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
    for (const name of this.layers ? ["depths", "normals", "colors", "occlusion"] : []) gl.deleteTexture(this.layers[name]);
    for (const name of this.layers ? ["layers", "half"] : []) gl.deleteFramebuffer(this.layers[name]);
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
    const normals = texture(sums, size, gl.LINEAR);
    const colors = texture(sums, size, gl.LINEAR);
    const occlusion = texture(gl.RGBA8, size.map((side) => Math.ceil(side / 2)), gl.LINEAR);
    const layers = target([[gl.COLOR_ATTACHMENT0, normals], [gl.COLOR_ATTACHMENT1, colors], [gl.DEPTH_ATTACHMENT, depths]]);
    this.layers = { depths, normals, colors, occlusion, layers, half: target([[gl.COLOR_ATTACHMENT0, occlusion]]) };
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

/** A plane `[n, d]` of world in the frame of the camera. @param {Float32Array} view @param {number[]} cut */
function toView(view, [x, y, z, d]) {
  const turned = [0, 1, 2].map((row) => view[row] * x + view[4 + row] * y + view[8 + row] * z);
  return [...turned, d + turned.reduce((sum, part, row) => sum + part * view[12 + row], 0)];
}
