/**
 * Vectors `[x, y, z]`, unit quaternions `[x, y, z, w]` and 4×4 matrices as the graphics card takes them: 16 numbers, column by column.
 * Every function makes a new array.
 *
 * @typedef {number[]} Vec3
 * @typedef {number[]} Quat
 * @typedef {Float32Array} Mat4
 * @typedef {{p: Vec3, q: Quat}} Pose position in m and orientation of a frame in another
 */

/** @type {(a: Vec3, b: Vec3) => Vec3} */
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];

/** @type {(a: Vec3, b: Vec3) => Vec3} */
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];

/** @type {(a: Vec3, s: number) => Vec3} */
export const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];

/** @type {(a: Vec3, b: Vec3) => number} */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** @type {(a: Vec3, b: Vec3) => Vec3} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** @type {(a: Vec3) => number} */
export const length = (a) => Math.hypot(a[0], a[1], a[2]);

/** The same direction with length 1; a vector without length becomes x. @type {(a: Vec3) => Vec3} */
export function normalize(a) {
  const l = length(a);
  return l > 0 ? scale(a, 1 / l) : [1, 0, 0];
}

/** True when all components are finite numbers: the server sends `null` for a value that is none. @type {(a: any) => boolean} */
export const isFinite3 = (a) => Array.isArray(a) && a.length >= 3 && a.every(Number.isFinite);

/** Rotates a vector. @type {(q: Quat, v: Vec3) => Vec3} */
export function rotate(q, v) {
  const u = [q[0], q[1], q[2]];
  const t = scale(cross(u, v), 2);
  return add(add(v, scale(t, q[3])), cross(u, t));
}

/** The turn about an axis of length 1 by an angle, rad. @type {(axis: Vec3, angle: number) => Quat} */
export function turnAbout(axis, angle) {
  return [...scale(axis, Math.sin(angle / 2)), Math.cos(angle / 2)];
}

/** The turn `b`, then the turn `a`. @type {(a: Quat, b: Quat) => Quat} */
export function turned(a, b) {
  const [u, v] = [a.slice(0, 3), b.slice(0, 3)];
  const w = a[3] * b[3] - dot(u, v);
  const xyz = add(add(scale(v, a[3]), scale(u, b[3])), cross(u, v));
  const size = Math.hypot(...xyz, w);
  return [...scale(xyz, 1 / size), w / size];
}

/** Angle between two orientations, rad. @param {number[]} a @param {number[]} b quaternions */
export const angleBetween = (a, b) => 2 * Math.acos(Math.min(1, Math.abs(a.reduce((sum, x, i) => sum + x * b[i], 0))));

/**
 * The nearest of the 24 orientations whose axes lie along those of the outer frame.
 * Their quaternions have one component of size 1, two of √½ or four of ½.
 * @type {(q: Quat) => Quat}
 */
export function squared(q) {
  const sizes = q.map(Math.abs).toSorted((a, b) => b - a);
  const share = (n) => sizes.slice(0, n).reduce((sum, x) => sum + x, 0) / Math.sqrt(n);
  const n = [1, 2, 4].reduce((best, each) => (share(each) > share(best) ? each : best));
  const largest = [0, 1, 2, 3].toSorted((a, b) => Math.abs(q[b]) - Math.abs(q[a])).slice(0, n);
  return q.map((x, axis) => (largest.includes(axis) ? (x < 0 ? -1 : 1) / Math.sqrt(n) : 0));
}

/** A point of the outer frame in a posed one. @type {(pose: Pose, v: Vec3) => Vec3} */
export const transformBack = ({ p, q: [x, y, z, w] }, v) => rotate([-x, -y, -z, w], subtract(v, p));

/** A point of a posed frame in the outer frame. @type {(pose: Pose, v: Vec3) => Vec3} */
export const transform = (pose, v) => add(rotate(pose.q, v), pose.p);

/** The eight corners of a box. @type {(box: {min: Vec3, max: Vec3}) => Vec3[]} */
export const cornersOf = ({ min, max }) => [0, 1, 2, 3, 4, 5, 6, 7].map((bits) => [0, 1, 2].map((axis) => (bits & (1 << axis) ? max : min)[axis]));

/** @type {(pose: Pose) => Mat4} */
export function matrixOfPose({ p, q: [x, y, z, w] }) {
  return new Float32Array([
    1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
    2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
    2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0,
    p[0], p[1], p[2], 1,
  ]);
}

/**
 * A frame whose z axis points along a direction, with its axes stretched.
 * @param {Vec3} origin
 * @param {Vec3} direction
 * @param {number} width stretch of x and y
 * @param {number} height stretch of z
 * @returns {Mat4}
 */
export function matrixAlong(origin, direction, width, height) {
  const z = normalize(direction);
  const x = normalize(cross(Math.abs(z[2]) < 0.9 ? [0, 0, 1] : [0, 1, 0], z));
  const y = cross(z, x);
  return new Float32Array([
    ...scale(x, width), 0,
    ...scale(y, width), 0,
    ...scale(z, height), 0,
    ...origin, 1,
  ]);
}

/** Applies `b` first. @type {(a: Mat4, b: Mat4) => Mat4} */
export function multiply(a, b) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column += 1) {
    for (let row = 0; row < 4; row += 1) {
      let sum = 0;
      for (let k = 0; k < 4; k += 1) sum += a[k * 4 + row] * b[column * 4 + k];
      out[column * 4 + row] = sum;
    }
  }
  return out;
}

/**
 * @param {number} heightAngle angle of view from bottom to top, rad
 * @param {number} aspect width over height
 * @param {number} near
 * @param {number} far
 * @returns {Mat4}
 */
export function perspective(heightAngle, aspect, near, far) {
  const f = 1 / Math.tan(heightAngle / 2);
  return new Float32Array([
    f / aspect, 0, 0, 0,
    0, f, 0, 0,
    0, 0, (far + near) / (near - far), -1,
    0, 0, (2 * far * near) / (near - far), 0,
  ]);
}

/** View of an eye that looks at a target, with `up` up. @type {(eye: Vec3, target: Vec3, up: Vec3) => Mat4} */
export function lookAt(eye, target, up) {
  const z = normalize(subtract(eye, target));
  const x = normalize(cross(up, z));
  const y = cross(z, x);
  return new Float32Array([
    x[0], y[0], z[0], 0,
    x[1], y[1], z[1], 0,
    x[2], y[2], z[2], 0,
    -dot(x, eye), -dot(y, eye), -dot(z, eye), 1,
  ]);
}

/** The smallest of 1, 2, 5, 10, 20, … (and 0.5, 0.2, …) that is not below a value; 0 for what is not above 0. @type {(value: number) => number} */
export function ceilTo125(value) {
  if (!(value > 0)) return 0;
  const decade = 10 ** Math.floor(Math.log10(value));
  const step = [1, 2, 5, 10].find((n) => n * decade >= value * (1 - 1e-9));
  return (step ?? 10) * decade;
}
