/**
 * Faces of voxels and points as they come from the server, made ready for drawing: a polygon for each.
 *
 * @typedef {object} Marks
 * @property {{positions: Float32Array, normals: Int8Array}} mesh as those of `mesh.js`
 * @property {Uint8Array} tints [4 × corners]
 * @property {number} n voxels or points that there are
 * @property {number} nDrawn faces or points that are drawn
 * @property {number} size edge of the voxels that were baked, m
 * @property {number} ownSize the same of the scene, m
 */

const HEAD_BYTES = 24;
const MARK_BYTES = 16;
/** Of a voxel, and of the one beside it. */
const COLORS = [
  [205, 160, 96],
  [232, 200, 150],
];
/** A face of a voxel is a square; a point is a disc that leaves room for the next. Corners; their distance from the middle, and that from the surface, voxels. */
const SHAPES = { voxels: { nCorners: 4, radius: Math.SQRT1_2, raised: 0 }, points: { nCorners: 6, radius: 0.25, raised: 0.05 } };

/** @param {ArrayBuffer} bytes `HVPS` of the API @param {"voxels"|"points"} kind @returns {Marks} */
export function unfold(bytes, kind) {
  const data = new DataView(bytes);
  const magic = String.fromCharCode(...new Uint8Array(bytes, 0, 4));
  if (magic !== "HVPS" || data.getUint32(4, true) !== 1) throw new Error("not voxels or points of a version that this page reads");
  const { nCorners, radius, raised } = SHAPES[kind];
  const nDrawn = data.getUint32(8, true);
  const size = data.getFloat32(16, true);
  const nCornersOfAll = 3 * (nCorners - 2) * nDrawn;
  const mesh = { positions: new Float32Array(3 * nCornersOfAll), normals: new Int8Array(4 * nCornersOfAll) };
  const tints = new Uint8Array(4 * nCornersOfAll);
  // A first corner halfway between the axes: the sides of a square are along them.
  const turns = Array.from({ length: nCorners }, (_, k) => (2 * Math.PI * (k + 0.5)) / nCorners);
  const steps = turns.map((turn) => [radius * size * Math.cos(turn), radius * size * Math.sin(turn)]);
  const [ring, along, across, outward] = [new Float32Array(3 * nCorners), [0, 0, 0], [0, 0, 0], [0, 0, 0]];
  for (let mark = 0, corner = 0; mark < nDrawn; mark += 1) {
    const at = HEAD_BYTES + MARK_BYTES * mark;
    for (let axis = 0; axis < 3; axis += 1) outward[axis] = data.getInt8(at + 12 + axis);
    spread(outward, along, across);
    for (let k = 0; k < nCorners; k += 1) {
      for (let axis = 0; axis < 3; axis += 1) {
        const middle = data.getFloat32(at + 4 * axis, true) + raised * size * outward[axis];
        ring[3 * k + axis] = middle + steps[k][0] * along[axis] + steps[k][1] * across[axis];
      }
    }
    const color = COLORS[data.getUint8(at + 15)];
    for (let k = 2; k < nCorners; k += 1) {
      for (const from of [0, k - 1, k]) {
        for (let axis = 0; axis < 3; axis += 1) {
          mesh.positions[3 * corner + axis] = ring[3 * from + axis];
          mesh.normals[4 * corner + axis] = data.getInt8(at + 12 + axis);
          tints[4 * corner + axis] = color[axis];
        }
        corner += 1;
      }
    }
  }
  return { mesh, tints, n: data.getUint32(12, true), nDrawn, size, ownSize: data.getFloat32(20, true) };
}

/** Makes `outward` a unit vector, and the others two that are across it and each other; along axes where it is along one. */
function spread(outward, along, across) {
  const l = Math.hypot(...outward) || 1;
  let flattest = 0;
  for (let axis = 0; axis < 3; axis += 1) {
    outward[axis] /= l;
    if (Math.abs(outward[axis]) < Math.abs(outward[flattest])) flattest = axis;
  }
  const [next, last] = [(flattest + 1) % 3, (flattest + 2) % 3];
  const s = Math.hypot(outward[next], outward[last]) || 1;
  across[flattest] = 0;
  across[next] = outward[last] / s;
  across[last] = -outward[next] / s;
  for (let axis = 0; axis < 3; axis += 1) {
    const [a, b] = [(axis + 1) % 3, (axis + 2) % 3];
    along[axis] = across[a] * outward[b] - across[b] * outward[a];
  }
}
