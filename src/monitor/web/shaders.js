/**
 * The programs of the graphics card. Those of parts have a variant `cut` besides, which leaves out what lies beyond a plane. All take `view_projection`
 * (of world) and `model` (world from the mesh's frame).
 */

const HEAD = `#version 300 es
precision highp float;
`;
/** What `LEAVE_OUT` stands for: a program that may discard is slower, so there are two of each. */
const WHOLE = `#define LEAVE_OUT
`;
const CUT = `uniform vec4 cut;
#define LEAVE_OUT if (dot(position_world, cut.xyz) > cut.w) discard;
`;

/** Lit faces, each corner in its tint of the colour. Light comes over the shoulder and from the sky; the back of an open mesh is lit like its front. */
const SURFACE = {
  vertex: `
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 normal;
layout(location = 2) in vec3 tint;
uniform mat4 view_projection;
uniform mat4 model;
out vec3 normal_world;
out vec3 position_world;
out vec3 tinted;
void main() {
  tinted = tint;
  mat3 m = mat3(model);
  // Arrows are stretched along their axes.
  normal_world = m * (normal.xyz / vec3(dot(m[0], m[0]), dot(m[1], m[1]), dot(m[2], m[2])));
  vec4 p = model * vec4(position, 1.0);
  position_world = p.xyz;
  gl_Position = view_projection * p;
}`,
  fragment: `
in vec3 normal_world;
in vec3 position_world;
in vec3 tinted;
uniform vec4 color;
uniform vec3 eye;
uniform vec3 light;
out vec4 pixel;
void main() {
  LEAVE_OUT
  vec3 n = normalize(gl_FrontFacing ? normal_world : -normal_world);
  vec3 to_eye = normalize(eye - position_world);
  float sky = 0.5 + 0.5 * n.z;
  float lit = max(dot(n, light), 0.0);
  float gloss = pow(max(dot(reflect(-light, n), to_eye), 0.0), 24.0);
  pixel = vec4(color.rgb * tinted * (0.42 + 0.2 * sky + 0.45 * lit) + 0.07 * gloss, color.a);
}`,
};

/** Lines of one colour. */
const LINE = {
  vertex: `
layout(location = 0) in vec3 position;
uniform mat4 view_projection;
uniform mat4 model;
out vec3 position_world;
void main() {
  vec4 p = model * vec4(position, 1.0);
  position_world = p.xyz;
  gl_Position = view_projection * p;
}`,
  fragment: `
in vec3 position_world;
uniform vec4 color;
out vec4 pixel;
void main() {
  LEAVE_OUT
  pixel = color;
}`,
};

/** Cut faces: one colour, hatched across the picture every `step_px`, to the one side or the other. */
const CAP = {
  vertex: LINE.vertex,
  fragment: `
uniform vec4 color;
uniform float slant;
uniform float step_px;
out vec4 pixel;
void main() {
  float off = abs(mod(gl_FragCoord.x + slant * gl_FragCoord.y, step_px) - 0.5 * step_px);
  float line = 1.0 - clamp(off - 0.5, 0.0, 1.0);
  pixel = vec4(color.rgb * (1.0 - 0.35 * line), color.a);
}`,
};

/** A ground with a line every `step_m` and a stronger one every ten, gone at the distance `reach`. */
const GRID = {
  vertex: `
layout(location = 0) in vec3 position;
uniform mat4 view_projection;
uniform mat4 model;
uniform float reach;
out vec2 ground;
void main() {
  vec4 p = model * vec4(position * reach, 1.0);
  ground = p.xy;
  gl_Position = view_projection * p;
}`,
  fragment: `
in vec2 ground;
uniform mat4 model;
uniform float reach;
uniform float step_m;
uniform vec4 color;
out vec4 pixel;
float lines(vec2 at, vec2 width) {
  vec2 off = abs(fract(at - 0.5) - 0.5) / width;
  // Where lines come closer than two pixels they fade instead of shimmering.
  vec2 line = (1.0 - min(off, 1.0)) * clamp(1.0 - 2.0 * width, 0.0, 1.0);
  return max(line.x, line.y);
}
void main() {
  float fade = 1.0 - smoothstep(0.2, 1.0, length(ground - model[3].xy) / reach);
  vec2 at = ground / step_m;
  vec2 width = fwidth(at);
  pixel = vec4(color.rgb, color.a * fade * max(0.45 * lines(at, width), lines(0.1 * at, 0.1 * width)));
}`,
};

/**
 * Round dots of `size_m`, but never too small or too large to see; `pixels` is how many a metre has at distance 1. The fourth component is
 * the depth, as a share of the deepest one.
 */
const POINT = {
  vertex: `
layout(location = 0) in vec4 position;
uniform mat4 view_projection;
uniform float size_m;
uniform float pixels;
uniform vec2 bounds;
out float share;
void main() {
  share = position.w;
  gl_Position = view_projection * vec4(position.xyz, 1.0);
  gl_PointSize = clamp(size_m * pixels / gl_Position.w, bounds.x, bounds.y) * (0.8 + 0.4 * share);
}`,
  fragment: `
in float share;
uniform vec4 color;
out vec4 pixel;
void main() {
  float off = length(gl_PointCoord - 0.5) * 2.0;
  float edge = 1.0 - smoothstep(0.75, 1.0, off);
  pixel = vec4(color.rgb, color.a * edge * (0.55 + 0.45 * share));
}`,
};

/**
 * @param {WebGL2RenderingContext} gl
 * @returns {{surface: Program, line: Program, cap: Program, grid: Program, point: Program}}
 * @typedef {{program: WebGLProgram, at: Object<string, WebGLUniformLocation>, cut: ?Program}} Program
 */
export function compile(gl) {
  const both = (source) => ({ ...link(gl, source), cut: link(gl, source, CUT) });
  const whole = (source) => link(gl, source);
  return { surface: both(SURFACE), line: both(LINE), cap: whole(CAP), grid: whole(GRID), point: whole(POINT) };
}

/** @param {WebGL2RenderingContext} gl @param {{vertex: string, fragment: string}} source @returns {Program} */
export function link(gl, source, head = WHOLE) {
  const program = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, source.vertex], [gl.FRAGMENT_SHADER, source.fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, HEAD + head + text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
    throw new Error(`the graphics card refused a program: ${logs.join(" ")}`);
  }
  const at = {};
  for (let n = 0; n < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); n += 1) {
    const { name } = gl.getActiveUniform(program, n);
    at[name] = gl.getUniformLocation(program, name);
  }
  return { program, at };
}
