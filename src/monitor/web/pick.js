/** From a place of the picture to a point of a part or of clay, and back. */

import { add, cross, dot, length, multiply, normalize, rotate, scale, subtract, transform } from "./math.js";

/** A corner of the part that is nearer to the pointer than this is taken instead, CSS pixels. */
const SNAP_PX = 8;
/** Where a part is looked for, CSS pixels from the pointer: a corner on its outline is hard to hit. */
const AROUND = [[0, 0], ...[0, 1, 2, 3, 4, 5, 6, 7].map((n) => [4 * Math.cos((n * Math.PI) / 4), 4 * Math.sin((n * Math.PI) / 4)])];

/** Bytes of a sample of clay. */
const SAMPLE_BYTES = 20;

/**
 * @typedef {{part: ?import("./scene.js").Part, local: number[]}} Pick a point that moves with its part, in the part's own frame, m; without a
 *   part it is one of the clay as that was, in the frame of its map
 */

/**
 * What is seen at a place of the window, or null.
 * @param {import("./scene.js").SceneView} view @param {number} x @param {number} y CSS pixels
 * @returns {?Pick}
 */
export function pickAt(view, x, y) {
  const nearest = AROUND.reduce((found, [dx, dy]) => found ?? seenAt(view, rayAt(view, x + dx, y + dy)), null);
  const clay = clayAt(view, x, y);
  if (clay && !(nearest?.along < clay.along)) return { part: null, local: toLocal(view.clay.pose, clay.point) };
  if (!nearest) return null;
  const { part, along, corners, ray } = nearest;
  const pose = view.standing(part);
  const snapped = corners
    .map((corner) => ({ corner, off: distanceTo(view, transform(pose, corner), x, y) }))
    .filter(({ corner, off }) => off < SNAP_PX && !isCut(view.cutOf(part.role), transform(pose, corner)))
    .sort((a, b) => a.off - b.off)[0];
  return { part, local: snapped?.corner ?? toLocal(pose, add(ray.origin, scale(ray.direction, along))) };
}

/** What a ray meets first. */
function seenAt(view, ray) {
  let nearest = null;
  for (const part of view.parts) {
    const hit = seenOf(view, part, ray);
    if (hit && (!nearest || hit.along < nearest.along)) nearest = { part, ray, ...hit };
  }
  return nearest;
}

/**
 * What is seen of the clay at a place of the window, world: where the line of sight meets the nearest disc that faces the eye.
 * @param {import("./scene.js").SceneView} view @param {number} x @param {number} y CSS pixels
 * @returns {?{along: number, point: number[], normal: number[]}} along: metres from the eye
 */
export function clayAt(view, x, y) {
  const { samples, pose } = view.clay;
  if (!samples) return null;
  const { origin, direction } = rayAt(view, x, y);
  const back = [-pose.q[0], -pose.q[1], -pose.q[2], pose.q[3]];
  const eye = toLocal(pose, origin);
  const ray = rotate(back, direction);
  const { bytes, n, spacing, unit } = samples;
  const cut = view.cutOf("clay");
  // Of the point so far along the ray: how far beyond the section plane.
  const beyond = (along) => (cut ? dot(cut, origin) - cut[3] + along * dot(cut, direction) : 0);
  const data = new DataView(bytes.buffer, bytes.byteOffset);
  let best = null;
  for (let at = 0; at < n * SAMPLE_BYTES; at += SAMPLE_BYTES) {
    const px = data.getFloat32(at, true) - eye[0];
    const py = data.getFloat32(at + 4, true) - eye[1];
    const pz = data.getFloat32(at + 8, true) - eye[2];
    const nearest = px * ray[0] + py * ray[1] + pz * ray[2];
    const away = px * px + py * py + pz * pz;
    // As it is drawn: where samples are far apart discs are large, and no line of sight passes between them.
    const radius = unit * data.getUint8(at + 15) || spacing;
    const most = radius * radius;
    if ((best && nearest - radius >= best.along) || away - nearest * nearest > most) continue;
    const [nx, ny, nz] = [data.getInt8(at + 12), data.getInt8(at + 13), data.getInt8(at + 14)];
    const facing = nx * ray[0] + ny * ray[1] + nz * ray[2];
    if (facing >= 0) continue;
    const along = (px * nx + py * ny + pz * nz) / facing;
    // Distance of that point from the middle of the disc, squared.
    const off = away - 2 * along * nearest + along * along;
    if (along > 0 && off <= most && !(along >= best?.along) && beyond(along) <= 0) best = { along, normal: [nx, ny, nz] };
  }
  if (!best) return null;
  const { along, normal } = best;
  return { along, point: add(origin, scale(direction, along)), normal: rotate(pose.q, scale(normal, 1 / length(normal))) };
}

/** Where a pick stands now, world. @param {import("./scene.js").SceneView} view @param {Pick} pick */
export const placeOf = (view, { part, local }) => transform(part ? view.standing(part) : view.clay.pose, local);

/** Place of a point in the picture, CSS pixels from its upper left corner; null behind the eye. @returns {?number[]} */
export function project({ canvas, camera }, [x, y, z]) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const m = multiply(camera.projection(width / Math.max(1, height)), camera.view);
  const row = (n) => m[n] * x + m[4 + n] * y + m[8 + n] * z + m[12 + n];
  const w = row(3);
  return w > 0 ? [(0.5 + (0.5 * row(0)) / w) * width, (0.5 - (0.5 * row(1)) / w) * height] : null;
}

function rayAt({ canvas, camera }, x, y) {
  const box = canvas.getBoundingClientRect();
  const projection = camera.projection(box.width / Math.max(1, box.height));
  const right = normalize(cross([0, 0, 1], camera.backward));
  const up = cross(camera.backward, right);
  const across = scale(right, ((2 * (x - box.left)) / box.width - 1) / projection[0]);
  const high = scale(up, (1 - (2 * (y - box.top)) / box.height) / projection[5]);
  return { origin: camera.eye, direction: normalize(subtract(add(across, high), camera.backward)) };
}

/**
 * Where a ray first meets what is drawn of a part: a face, or the face that the section plane cut.
 * @returns {?{along: number, corners: number[][]}} metres along the ray, and the corners of the triangle, the part's own frame
 */
function seenOf(view, part, ray) {
  const pose = view.standing(part);
  const back = [-pose.q[0], -pose.q[1], -pose.q[2], pose.q[3]];
  const origin = toLocal(pose, ray.origin);
  const direction = rotate(back, ray.direction);
  const { positions } = part.mesh;
  const cut = view.cutOf(part.role);
  // Along the ray: how far the eye is beyond the plane, and how fast that grows.
  const beyond = cut ? dot(cut, ray.origin) - cut[3] : 0;
  const growth = cut ? dot(cut, ray.direction) : 0;
  const plane = growth !== 0 ? -beyond / growth : Infinity;
  let nearest = null;
  let nBehind = 0;
  for (let n = 0; n < positions.length; n += 9) {
    const along = meet(positions, n, origin, direction);
    if (along === null || (cut && beyond + along * growth > 0)) continue;
    if (along > plane) nBehind += 1;
    if (!nearest || along < nearest.along) nearest = { along, n };
  }
  // The ray comes out of the part more often than it goes in behind the plane: it is inside of it there.
  if (cut && beyond > 0 && plane > 0 && nBehind % 2 === 1) return { along: plane, corners: [] };
  if (!nearest) return null;
  const corners = [0, 3, 6].map((k) => [...positions.subarray(nearest.n + k, nearest.n + k + 3)]);
  return { along: nearest.along, corners };
}

/** How far along a ray a triangle is met (Möller and Trumbore 1997); null where it is not. Numbers only: a part may have 100,000. */
function meet(p, n, [ox, oy, oz], [dx, dy, dz]) {
  const [ax, ay, az] = [p[n], p[n + 1], p[n + 2]];
  const [ux, uy, uz] = [p[n + 3] - ax, p[n + 4] - ay, p[n + 5] - az];
  const [vx, vy, vz] = [p[n + 6] - ax, p[n + 7] - ay, p[n + 8] - az];
  const [hx, hy, hz] = [dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx];
  const det = ux * hx + uy * hy + uz * hz;
  if (det === 0) return null;
  const [sx, sy, sz] = [ox - ax, oy - ay, oz - az];
  const a = (sx * hx + sy * hy + sz * hz) / det;
  if (a < 0 || a > 1) return null;
  const [qx, qy, qz] = [sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux];
  const b = (dx * qx + dy * qy + dz * qz) / det;
  if (b < 0 || a + b > 1) return null;
  const along = (vx * qx + vy * qy + vz * qz) / det;
  return along > 0 ? along : null;
}

const isCut = (cut, point) => cut !== null && dot(cut, point) > cut[3];

const toLocal = ({ p, q }, point) => rotate([-q[0], -q[1], -q[2], q[3]], subtract(point, p));

function distanceTo(view, point, x, y) {
  const at = project(view, point);
  const box = view.canvas.getBoundingClientRect();
  return at ? Math.hypot(at[0] + box.left - x, at[1] + box.top - y) : Infinity;
}
