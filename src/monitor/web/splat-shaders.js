/**
 * Programs that draw a surface from its samples: surface splatting in two passes (depth of the nearest discs, then normals and colours of the discs
 * near that depth, weighted and added), occlusion from that depth, light, and the picture.
 *
 * All is in the frame of the camera: the eye in the origin, x to the right, y up, it looks along −z.
 */

/**
 * A disc across the normal of each sample, as large as samples are apart around it, as an ellipse of the picture: the disc's Gaussian after the derivative of the
 * projection in its middle, and the low-pass filter of the picture's pixels, which add up (elliptical weighted average, Zwicker 2001). So a disc that is
 * seen from far away or from its side still has the width of a pixel. `place` is 1 long at the rim. Depth is that of the disc's plane, nearer to the eye by
 * `lift`. Backs are left out. Three corners of one drawing for each, which read the sample from a texture: drivers that draw with the processor take many times
 * as long for as many instances.
 */
const DISC = `
precision highp usampler2D;
uniform usampler2D samples;
uniform mat4 model;
uniform mat4 projection;
uniform vec4 cut;
uniform vec2 half_px;
uniform float overlap;
uniform float spacing;
uniform float unit;
uniform float low_pass;
uniform float lift;
out vec2 place;
out float beyond;
flat out vec3 facing;
flat out vec3 color;
flat out float squeezed;
#ifdef FACES_EYE
uniform highp int form;
flat out mat3 turned;
flat out vec4 ball;
#endif
void main() {
  int sampled = gl_VertexID / 3;
  ivec2 first = ivec2(5 * (sampled & 511), sampled >> 9);
  uint words[5];
  for (int n = 0; n < 5; n += 1) words[n] = texelFetch(samples, first + ivec2(n, 0), 0).r;
  vec4 p = model * vec4(uintBitsToFloat(words[0]), uintBitsToFloat(words[1]), uintBitsToFloat(words[2]), 1.0);
  ivec3 bytes = ivec3(words[3] << 24, words[3] << 16, words[3] << 8) >> 24;
  vec3 n = normalize(mat3(model) * vec3(bytes));
  vec3 to_eye = normalize(-p.xyz);
  float far = -p.z;
  uint parts = words[3] >> 24;
  float reach = overlap * (parts > 0u ? float(parts) * unit : spacing);
  // Some of the back is left: the normals of a rim are not quite right.
  if (dot(n, to_eye) < -0.15 || far < 0.5 * reach) {
    gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
    return;
  }
#ifdef FACES_EYE
  vec3 across = form == 1 ? n : to_eye;
#else
  vec3 across = n;
#endif
  vec3 u = normalize(cross(abs(across.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0), across));
  vec3 v = cross(across, u);
  // Half axes in pixels.
  vec2 scale = half_px * vec2(projection[0][0], projection[1][1]) * reach / far;
  vec2 a = scale * (u.xy + p.xy * (u.z / far));
  vec2 b = scale * (v.xy + p.xy * (v.z / far));
  // The triangle around a circle.
  int corner = gl_VertexID % 3;
  place = corner == 0 ? vec2(0.0, 2.0) : vec2(corner == 1 ? -1.7320508 : 1.7320508, -1.0);
#ifdef FACES_EYE
  float wide = max(1.0, sqrt(low_pass / max(dot(a, a), 1e-9)));
  vec2 off_px = wide * (place.x * a + place.y * b);
  reach *= wide;
  turned = mat3(u, v, across);
  ball = vec4(p.xyz, reach);
#else
  // The sum of both filters is L L^T; L of a circle is the ellipse.
  float xx = a.x * a.x + b.x * b.x + low_pass;
  float yx = a.x * a.y + b.x * b.y;
  float l = sqrt(xx);
  float m = sqrt(max(a.y * a.y + b.y * b.y + low_pass - yx * yx / xx, 1e-9));
  vec2 off_px = vec2(l * place.x, yx / l * place.x + m * place.y);
  squeezed = max(abs(a.x * b.y - a.y * b.x) / (l * m), 0.1);
#endif
  vec2 at = p.xy / far * vec2(projection[0][0], projection[1][1]) + off_px / half_px;
  // Where the line of sight meets the plane; for a disc that is seen from its side, no farther from its middle than its rim.
  vec3 sight = vec3(at / vec2(projection[0][0], projection[1][1]), -1.0);
  float slope = dot(across, p.xyz);
  float near = abs(slope) > 1e-6 * far ? dot(across, sight) / slope : 1.0 / far;
  near = clamp(near, 1.0 / (far + 2.0 * reach), 1.0 / max(far - 2.0 * reach, 0.25 * far));
  beyond = dot(sight, cut.xyz) - cut.w * near;
  // A disc from its side has been made wider than its plane tells the depth of: it belongs to the same surface also where that is farther.
  float lifted = lift;
#ifndef FACES_EYE
  lifted /= squeezed;
#endif
  near = 1.0 / (1.0 / near - lifted / length(sight));
  facing = 0.5 + 0.5 * n;
  color = vec3(uvec3(words[4], words[4] >> 8, words[4] >> 16) & 255u) / 255.0;
  gl_Position = vec4(at, -projection[2][2] + projection[3][2] * near, 1.0);
}`;

/** What is seen: depth alone. */
export const NEAREST = {
  vertex: DISC,
  fragment: `
in vec2 place;
in float beyond;
void main() {
  if (beyond > 0.0 || dot(place, place) > 1.0) discard;
}`,
};

/**
 * Normals and colours, each times a weight that falls from the middle to the rim as a Gaussian of 0.41 of the radius does; less where the low-pass filter has made the
 * disc larger.
 */
export const BLENDED = {
  vertex: DISC,
  fragment: `
in vec2 place;
in float beyond;
flat in vec3 facing;
flat in vec3 color;
flat in float squeezed;
uniform float share;
layout(location = 0) out vec4 normals;
layout(location = 1) out vec4 colors;
void main() {
  float off = dot(place, place);
  if (beyond > 0.0 || off > 1.0) discard;
  float weight = share * squeezed * exp(-3.0 * off);
  normals = weight * vec4(facing, 1.0);
  colors = weight * vec4(color, 1.0);
}`,
};

/** Samples each for itself: 1 a disc across its normal, 2 a sprite, which faces the eye, 3 a sphere. The nearest one is seen, in the light of its normal. */
export const SINGLE = {
  vertex: `#define FACES_EYE${DISC}`,
  fragment: `
in vec2 place;
in float beyond;
flat in vec3 facing;
flat in vec3 color;
flat in mat3 turned;
flat in vec4 ball;
uniform highp int form;
uniform mat4 projection;
layout(location = 0) out vec4 normals;
layout(location = 1) out vec4 colors;
void main() {
  float off = dot(place, place);
  if (beyond > 0.0 || off > 1.0) discard;
  vec3 n = 2.0 * facing - 1.0;
  gl_FragDepth = gl_FragCoord.z;
  if (form == 3) {
    n = turned * vec3(place, sqrt(1.0 - off));
    vec4 at = projection * vec4(ball.xyz + ball.w * n, 1.0);
    gl_FragDepth = clamp(0.5 + 0.5 * at.z / at.w, 0.0, 1.0);
  }
  normals = vec4(0.5 + 0.5 * n, 1.0);
  colors = vec4(color, 1.0);
}`,
};

/** One triangle over the picture. */
const ALL = `
out vec2 uv;
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  uv = 0.5 + 0.5 * corner;
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

const PLACE = `
precision highp sampler2D;
uniform sampler2D depths;
uniform sampler2D normals;
uniform mat4 projection;
vec3 placeAt(vec2 at, float depth) {
  float z = -projection[3][2] / (2.0 * depth - 1.0 + projection[2][2]);
  return vec3((1.0 - 2.0 * at) / vec2(projection[0][0], projection[1][1]), 1.0) * z;
}`;

/**
 * How much of the sky other places of the surface hide: those in front of its plane, nearer than `reach`. Each pixel of a block of 4 × 4 looks along
 * a spiral that is turned in its own way; light takes the mean of the block. Red: what is open, where there is a surface; green: whether there is one.
 */
export const OCCLUSION = {
  vertex: ALL,
  fragment: `
in vec2 uv;
${PLACE}
uniform float reach;
out vec4 pixel;
const int STEPS = 8;
// Of 2.4 rad: steps lie as the seeds of a sunflower.
const mat2 TURN = mat2(-0.7374, 0.6755, -0.6755, -0.7374);
void main() {
  float depth = texture(depths, uv).r;
  if (depth == 1.0) {
    pixel = vec4(0.0);
    return;
  }
  vec4 sum = texture(normals, uv);
  vec3 n = normalize(2.0 * sum.xyz / max(sum.w, 1e-4) - 1.0);
  vec3 p = placeAt(uv, depth);
  // Shares of the picture's height; a surface near the eye is not looked at across all of the picture.
  float wide = min(0.5 * reach * projection[1][1] / -p.z, 0.2);
  ivec2 cell = ivec2(gl_FragCoord.xy) & 3;
  float turn = 6.2832 * float((cell.x * 4 + cell.y * 7 + cell.x * cell.y * 5) & 15) / 16.0;
  vec2 way = vec2(cos(turn), sin(turn));
  vec2 wide_uv = wide * vec2(projection[0][0] / projection[1][1], 1.0);
  float hidden = 0.0;
  for (int k = 0; k < STEPS; k += 1) {
    float along = (float(k) + 0.5) / float(STEPS);
    vec2 at = uv + along * wide_uv * way;
    way = TURN * way;
    float there = texture(depths, at).r;
    vec3 v = placeAt(at, there) - p;
    float far = length(v);
    // Discs are flat and the surface is not: what is barely in front of its plane hides nothing.
    float front = max(dot(v, n) - 0.06 * far - 0.01 * reach, 0.0) / max(far, 1e-9);
    hidden += there < 1.0 ? front * max(1.0 - far / (1.5 * reach), 0.0) : 0.0;
  }
  pixel = vec4(1.0 - clamp(4.5 * hidden / float(STEPS), 0.0, 0.85), 1.0, 0.0, 1.0);
}`,
};

/** Two lights and a sky. */
const TWO_LIGHTS = `vec3 light(vec3 n, vec3 to_eye, vec3 color, float open) {
  float sky = 0.5 + 0.5 * dot(n, up);
  float key = max(dot(n, KEY), 0.0);
  float gloss = pow(max(dot(n, normalize(KEY + to_eye)), 0.0), 36.0);
  vec3 sum = mix(vec3(0.15, 0.14, 0.14), vec3(0.29, 0.3, 0.32), sky) * open + mix(0.3, 1.0, open) * (0.66 * key * vec3(1.0, 0.98, 0.95) + 0.13 * max(dot(n, FILL), 0.0));
  return color * sum + 0.05 * gloss * open;
}`;

/** Pictures of a lit ball by which normals take their light. */
const WAX = `vec3 light(vec3 n, vec3 to_eye, vec3 color, float open) {
  float lit = 0.5 + 0.5 * dot(n, KEY);
  vec3 ball = mix(vec3(0.08, 0.02, 0.012), vec3(0.56, 0.2, 0.11), smoothstep(0.1, 0.95, lit));
  ball += vec3(0.09, 0.03, 0.02) * pow(1.0 - max(n.z, 0.0), 2.0);
  // Paint keeps its hue: only what has none takes that of wax.
  float most = max(color.r, max(color.g, color.b));
  float hue = (most - min(color.r, min(color.g, color.b))) / max(most, 1e-3);
  ball = mix(ball, vec3(1.4 * dot(ball, vec3(0.3, 0.5, 0.2))), hue);
  ball += vec3(0.75, 0.6, 0.5) * (0.16 * pow(lit, 14.0) + 0.3 * pow(lit, 90.0));
  return 1.5 * color * ball * open;
}`;
const METAL = `vec3 light(vec3 n, vec3 to_eye, vec3 color, float open) {
  vec3 r = reflect(vec3(0.0, 0.0, -1.0), n);
  float sky = smoothstep(-0.15, 0.2, r.y);
  vec3 ball = mix(vec3(0.05, 0.045, 0.04) + 0.1 * max(-r.y, 0.0), mix(vec3(0.75, 0.78, 0.82), vec3(0.2, 0.26, 0.36), smoothstep(0.0, 1.0, r.y)), sky);
  ball += 0.7 * smoothstep(0.9, 0.97, dot(r, KEY));
  return 1.4 * color * ball * open;
}`;

/**
 * Light on the surface, of a look by its number, with how much of each pixel is covered; depth: that of the surface. A program for each look: the processor, where it
 * draws, works through all branches. The coarse one, for what moves and is slow to draw, leaves occlusion and the smooth outline out, which are most of the work there.
 */
export const lit = (look, isCoarse) => ({
  vertex: ALL,
  fragment: `${isCoarse ? "#define COARSE" : ""}
in vec2 uv;
${PLACE}
uniform sampler2D colors;
uniform sampler2D occlusion;
uniform vec2 size_px;
uniform vec2 blur_uv;
uniform vec3 up;
out vec4 pixel;
const vec3 KEY = vec3(-0.394, 0.573, 0.718);
const vec3 FILL = vec3(0.857, -0.171, 0.485);
${[TWO_LIGHTS, WAX, METAL][look]}
void main() {
  ivec2 here = ivec2(gl_FragCoord.xy);
  vec4 sum = texelFetch(normals, here, 0);
  if (sum.w == 0.0) discard;
  float own = texelFetch(depths, here, 0).r;
  float depth = own;
  float covered = depth < 1.0 ? 6.0 : 0.0;
#ifndef COARSE
  // Of pixels along the outline a part is covered.
  covered = min(covered, 2.0);
  ivec2 last = ivec2(size_px) - 1;
  for (int k = 0; k < 4; k += 1) {
    ivec2 beside = here + ivec2(k == 0 ? 1 : k == 1 ? -1 : 0, k == 2 ? 1 : k == 3 ? -1 : 0);
    float there = texelFetch(depths, clamp(beside, ivec2(0), last), 0).r;
    if (there == 1.0) continue;
    covered += 1.0;
    if (covered == 1.0) depth = there;
  }
  // A gap of one pixel is none.
  if (covered > 2.5 && own == 1.0) covered = 6.0;
#endif
  if (covered == 0.0) discard;
  vec3 n = normalize(2.0 * sum.xyz / sum.w - 1.0);
  vec3 to_eye = normalize(-placeAt(uv, depth));
  vec4 tint = texelFetch(colors, here, 0);
  // Lights add up, and bytes of a picture do not: they are near the square roots of light.
  vec3 color = tint.rgb / max(tint.a, 1e-4);
  color *= color;
  float seen = 1.0;
#ifndef COARSE
  vec2 open = vec2(0.0);
  for (int k = 0; k < 4; k += 1) open += texture(occlusion, uv + blur_uv * (vec2(k & 1, k >> 1) - 0.5)).rg;
  if (open.y > 0.0) seen = open.x / open.y;
#endif
  pixel = vec4(sqrt(light(n, to_eye, color, seen)), covered / 6.0);
  gl_FragDepth = depth;
}`,
});

/** The finished picture of the surface, among parts and tool. */
export const SHOWN = {
  vertex: ALL,
  fragment: `
in vec2 uv;
precision highp sampler2D;
uniform sampler2D picture;
uniform sampler2D reached;
uniform float opacity;
out vec4 pixel;
void main() {
  ivec2 here = ivec2(gl_FragCoord.xy);
  pixel = texelFetch(picture, here, 0);
  if (pixel.a == 0.0) discard;
  pixel.a *= opacity;
  gl_FragDepth = texelFetch(reached, here, 0).r;
}`,
};
