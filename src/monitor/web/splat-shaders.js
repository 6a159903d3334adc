/**
 * Programs that draw a surface from its samples: surface splatting in two passes (depth of the nearest discs, then normals and colours of the discs
 * near that depth, weighted and added), occlusion from that depth, and light.
 *
 * All is in the frame of the camera: the eye in the origin, x to the right, y up, it looks along −z.
 */

/**
 * A disc across the normal of each sample, as large as samples are apart around it, nearer to the eye by `lift`. Backs are left out. Three corners of one
 * drawing for each, which read the sample from a texture: drivers that draw with the processor take many times as long for as many instances.
 */
const DISC = `
precision highp usampler2D;
uniform usampler2D samples;
uniform mat4 model;
uniform mat4 projection;
uniform vec4 cut;
uniform float overlap;
uniform float spacing;
uniform float unit;
uniform float least;
uniform float lift;
out vec2 place;
out float beyond;
flat out vec3 facing;
flat out vec3 color;
void main() {
  int sampled = gl_VertexID / 3;
  ivec2 first = ivec2(5 * (sampled & 511), sampled >> 9);
  uint words[5];
  for (int n = 0; n < 5; n += 1) words[n] = texelFetch(samples, first + ivec2(n, 0), 0).r;
  vec4 p = model * vec4(uintBitsToFloat(words[0]), uintBitsToFloat(words[1]), uintBitsToFloat(words[2]), 1.0);
  ivec3 bytes = ivec3(words[3] << 24, words[3] << 16, words[3] << 8) >> 24;
  vec3 n = normalize(mat3(model) * vec3(bytes));
  vec3 to_eye = normalize(-p.xyz);
  // Some of the back is left: the normals of a rim are not quite right.
  if (dot(n, to_eye) < -0.15) {
    gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
    return;
  }
  vec3 u = normalize(cross(abs(n.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0), n));
  uint parts = words[3] >> 24;
  // From far away a disc still covers the pixel that it is in.
  float reach = max(overlap * (parts > 0u ? float(parts) * unit : spacing), -least * p.z);
  // The triangle around a circle.
  int corner = gl_VertexID % 3;
  place = corner == 0 ? vec2(0.0, 2.0) : vec2(corner == 1 ? -1.7320508 : 1.7320508, -1.0);
  vec3 at = p.xyz + reach * (place.x * u + place.y * cross(n, u));
  beyond = dot(at, cut.xyz) - cut.w;
  facing = 0.5 + 0.5 * n;
  color = vec3(uvec3(words[4], words[4] >> 8, words[4] >> 16) & 255u) / 255.0;
  gl_Position = projection * vec4(at * (1.0 - lift / length(at)), 1.0);
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

/** Normals and colours, each times a weight that falls from the middle to the rim as a Gaussian of 0.41 of the radius does. */
export const BLENDED = {
  vertex: DISC,
  fragment: `
in vec2 place;
in float beyond;
flat in vec3 facing;
flat in vec3 color;
uniform float share;
layout(location = 0) out vec4 normals;
layout(location = 1) out vec4 colors;
void main() {
  float off = dot(place, place);
  if (beyond > 0.0 || off > 1.0) discard;
  float weight = share * exp(-3.0 * off);
  normals = weight * vec4(facing, 1.0);
  colors = weight * vec4(color, 1.0);
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

/** Looks: two lights and a sky (0), and pictures of a lit ball by which normals take their light: wax (1), and metal (2). */
export const LIT = {
  vertex: ALL,
  fragment: `
in vec2 uv;
${PLACE}
uniform sampler2D colors;
uniform sampler2D occlusion;
uniform vec2 step_uv;
uniform vec2 blur_uv;
uniform vec3 up;
uniform float opacity;
uniform int look;
out vec4 pixel;
const vec3 KEY = vec3(-0.394, 0.573, 0.718);
const vec3 FILL = vec3(0.857, -0.171, 0.485);
vec3 twoLights(vec3 n, vec3 to_eye, vec3 color, float open) {
  float sky = 0.5 + 0.5 * dot(n, up);
  float key = max(dot(n, KEY), 0.0);
  float gloss = pow(max(dot(n, normalize(KEY + to_eye)), 0.0), 36.0);
  vec3 light = mix(vec3(0.15, 0.14, 0.14), vec3(0.29, 0.3, 0.32), sky) * open + mix(0.3, 1.0, open) * (0.66 * key * vec3(1.0, 0.98, 0.95) + 0.13 * max(dot(n, FILL), 0.0));
  return color * light + 0.05 * gloss * open;
}
vec3 wax(vec3 n, vec3 color, float open) {
  float lit = 0.5 + 0.5 * dot(n, KEY);
  vec3 ball = mix(vec3(0.08, 0.02, 0.012), vec3(0.56, 0.2, 0.11), smoothstep(0.1, 0.95, lit));
  ball += vec3(0.09, 0.03, 0.02) * pow(1.0 - max(n.z, 0.0), 2.0);
  // Paint keeps its hue: only what has none takes that of wax.
  float most = max(color.r, max(color.g, color.b));
  float hue = (most - min(color.r, min(color.g, color.b))) / max(most, 1e-3);
  ball = mix(ball, vec3(1.4 * dot(ball, vec3(0.3, 0.5, 0.2))), hue);
  ball += vec3(0.75, 0.6, 0.5) * (0.16 * pow(lit, 14.0) + 0.3 * pow(lit, 90.0));
  return 1.5 * color * ball * open;
}
vec3 metal(vec3 n, vec3 color, float open) {
  vec3 r = reflect(vec3(0.0, 0.0, -1.0), n);
  float sky = smoothstep(-0.15, 0.2, r.y);
  vec3 ball = mix(vec3(0.05, 0.045, 0.04) + 0.1 * max(-r.y, 0.0), mix(vec3(0.75, 0.78, 0.82), vec3(0.2, 0.26, 0.36), smoothstep(0.0, 1.0, r.y)), sky);
  ball += 0.7 * smoothstep(0.9, 0.97, dot(r, KEY));
  return 1.4 * color * ball * open;
}
void main() {
  vec4 sum = texture(normals, uv);
  if (sum.w == 0.0) discard;
  float depth = texture(depths, uv).r;
  // Of pixels along the outline a part is covered.
  float covered = depth < 1.0 ? 2.0 : 0.0;
  for (int k = 0; k < 4; k += 1) {
    float there = texture(depths, uv + step_uv * vec2(k == 0 ? 1 : k == 1 ? -1 : 0, k == 2 ? 1 : k == 3 ? -1 : 0)).r;
    if (there == 1.0) continue;
    covered += 1.0;
    if (covered == 1.0) depth = there;
  }
  if (covered == 0.0) discard;
  // A gap of one pixel is none.
  if (covered > 2.5 && texture(depths, uv).r == 1.0) covered = 6.0;
  vec3 n = normalize(2.0 * sum.xyz / sum.w - 1.0);
  vec3 to_eye = normalize(-placeAt(uv, depth));
  vec4 tint = texture(colors, uv);
  // Lights add up, and bytes of a picture do not: they are near the square roots of light.
  vec3 color = tint.rgb / max(tint.a, 1e-4);
  color *= color;
  vec2 open = vec2(0.0);
  for (int k = 0; k < 4; k += 1) open += texture(occlusion, uv + blur_uv * (vec2(k & 1, k >> 1) - 0.5)).rg;
  float seen = open.y > 0.0 ? open.x / open.y : 1.0;
  vec3 light = look == 1 ? wax(n, color, seen) : look == 2 ? metal(n, color, seen) : twoLights(n, to_eye, color, seen);
  pixel = vec4(sqrt(light), opacity * covered / 6.0);
  gl_FragDepth = depth;
}`,
};
