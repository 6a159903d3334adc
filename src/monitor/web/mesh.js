/**
 * Meshes as they come from the server, made ready for drawing: one normal per corner, so that a face is flat and a cylinder is round, and
 * the sharp edges as lines, as on a drawing.
 *
 * @typedef {object} Mesh
 * @property {Float32Array} positions [3 × corners], three corners per triangle, m, the object's own frame
 * @property {Int8Array} normals [4 × corners], x, y, z as parts of 127, and one byte of filling
 * @property {Float32Array} edges [6 × edges], both ends of every sharp edge
 * @property {number[]} min
 * @property {number[]} max corners of the box around it
 */

/** Faces that meet at less than this angle are one smooth surface. */
const SMOOTH_BELOW_COS = Math.cos((32 * Math.PI) / 180);
/** Where more of the edges than this share are sharp, lines would hide a scan rather than explain a part. */
const MOST_SHARP_SHARE = 0.36;

/**
 * @param {ArrayBuffer} bytes `HMSH`, u32 version, u32 vertices, u32 indices, f32 positions, u32 indices; little-endian
 * @returns {{positions: Float32Array, indices: Uint32Array}}
 */
export function parse(bytes) {
  const head = new DataView(bytes);
  const magic = String.fromCharCode(...new Uint8Array(bytes, 0, 4));
  if (magic !== "HMSH" || head.getUint32(4, true) !== 1) throw new Error("not a mesh of a version that this page reads");
  const nVertices = head.getUint32(8, true);
  const nIndices = head.getUint32(12, true);
  return {
    positions: new Float32Array(bytes, 16, 3 * nVertices),
    indices: new Uint32Array(bytes, 16 + 12 * nVertices, nIndices),
  };
}

/**
 * @param {{positions: Float32Array, indices: Uint32Array}} mesh
 * @param {boolean=} isThinned whether triangles were taken out: that leaves sharp edges where the part has none, so none are drawn
 * @returns {Mesh}
 */
export function prepare({ positions, indices }, isThinned = false) {
  const corners = weld(positions, indices);
  const faceNormals = normalsOfFaces(positions, indices);
  return {
    positions: unfold(positions, indices),
    normals: normalsOfCorners(corners, faceNormals, positions.length / 3),
    edges: isThinned ? new Float32Array(0) : sharpEdges(positions, corners, faceNormals),
    ...box(positions),
  };
}

/** The position of every corner. */
function unfold(positions, indices) {
  const corners = new Float32Array(3 * indices.length);
  for (let n = 0; n < indices.length; n += 1) {
    for (let axis = 0; axis < 3; axis += 1) corners[3 * n + axis] = positions[3 * indices[n] + axis];
  }
  return corners;
}

/** Indices in which vertices of equal position have one number: files like STL repeat a vertex per triangle. */
function weld(positions, indices) {
  const same = new Uint32Array(positions.length / 3);
  // Minus zero is zero.
  const bits = new Int32Array(positions.map((x) => x + 0).buffer);
  // A hash table of vertices by position, at most half full; a taken place sends on to the next.
  const mask = 2 ** Math.ceil(Math.log2(2 * same.length + 1)) - 1;
  const table = new Int32Array(mask + 1).fill(-1);
  for (let vertex = 0; vertex < same.length; vertex += 1) {
    const [x, y, z] = [bits[3 * vertex], bits[3 * vertex + 1], bits[3 * vertex + 2]];
    const hash = Math.imul(Math.imul(Math.imul(x, 73856093) ^ y, 19349663) ^ z, 83492791);
    let place = (hash ^ (hash >>> 15)) & mask;
    let other = table[place];
    while (other >= 0 && (bits[3 * other] !== x || bits[3 * other + 1] !== y || bits[3 * other + 2] !== z)) {
      place = (place + 1) & mask;
      other = table[place];
    }
    if (other < 0) table[place] = vertex;
    same[vertex] = other < 0 ? vertex : other;
  }
  return indices.map((vertex) => same[vertex]);
}

/** Unit normals, [3 × triangles]; zero for a triangle without area. */
function normalsOfFaces(positions, indices) {
  const normals = new Float32Array(indices.length);
  for (let n = 0; n < indices.length; n += 3) {
    const [a, b, c] = [3 * indices[n], 3 * indices[n + 1], 3 * indices[n + 2]];
    const ux = positions[b] - positions[a];
    const uy = positions[b + 1] - positions[a + 1];
    const uz = positions[b + 2] - positions[a + 2];
    const vx = positions[c] - positions[a];
    const vy = positions[c + 1] - positions[a + 1];
    const vz = positions[c + 2] - positions[a + 2];
    const x = uy * vz - uz * vy;
    const y = uz * vx - ux * vz;
    const z = ux * vy - uy * vx;
    const l = Math.hypot(x, y, z) || 1;
    normals[n] = x / l;
    normals[n + 1] = y / l;
    normals[n + 2] = z / l;
  }
  return normals;
}

/** Of every corner the mean normal of the faces around its vertex that are smooth with its own. */
function normalsOfCorners(corners, faceNormals, nVertices) {
  // Corners by vertex: those of vertex v are sorted[start[v] .. start[v + 1]].
  const start = new Uint32Array(nVertices + 1);
  for (const vertex of corners) start[vertex + 1] += 1;
  for (let v = 0; v < nVertices; v += 1) start[v + 1] += start[v];
  const next = start.slice();
  const sorted = new Uint32Array(corners.length);
  corners.forEach((vertex, corner) => {
    sorted[next[vertex]++] = corner;
  });

  const normals = new Int8Array(4 * corners.length);
  for (let corner = 0; corner < corners.length; corner += 1) {
    const own = corner - (corner % 3);
    let [x, y, z] = [0, 0, 0];
    for (let n = start[corners[corner]]; n < start[corners[corner] + 1]; n += 1) {
      const other = sorted[n] - (sorted[n] % 3);
      const cos =
        faceNormals[own] * faceNormals[other] +
        faceNormals[own + 1] * faceNormals[other + 1] +
        faceNormals[own + 2] * faceNormals[other + 2];
      if (cos < SMOOTH_BELOW_COS) continue;
      x += faceNormals[other];
      y += faceNormals[other + 1];
      z += faceNormals[other + 2];
    }
    const l = 127 / (Math.hypot(x, y, z) || 1);
    normals[4 * corner] = Math.round(x * l);
    normals[4 * corner + 1] = Math.round(y * l);
    normals[4 * corner + 2] = Math.round(z * l);
  }
  return normals;
}

/** Edges at which two faces meet at a sharp angle, or where the mesh ends. */
function sharpEdges(positions, corners, faceNormals) {
  const nVertices = positions.length / 3;
  /** @type {Map<number, number>} face that an edge was first seen at; -1: met by a smooth one */
  const seen = new Map();
  const sharp = [];
  for (let n = 0; n < corners.length; n += 1) {
    const face = n - (n % 3);
    const a = corners[n];
    const b = corners[face + ((n + 1) % 3)];
    if (a === b) continue;
    const key = Math.min(a, b) * nVertices + Math.max(a, b);
    const other = seen.get(key);
    if (other === undefined) {
      seen.set(key, face);
      continue;
    }
    seen.set(key, -1);
    if (other < 0) continue;
    const cos =
      faceNormals[face] * faceNormals[other] +
      faceNormals[face + 1] * faceNormals[other + 1] +
      faceNormals[face + 2] * faceNormals[other + 2];
    if (cos < SMOOTH_BELOW_COS) sharp.push(key);
  }
  for (const [key, face] of seen) if (face >= 0) sharp.push(key);
  if (sharp.length > MOST_SHARP_SHARE * seen.size && seen.size > 1000) return new Float32Array(0);
  const lines = new Float32Array(6 * sharp.length);
  sharp.forEach((key, n) => {
    const [a, b] = [Math.floor(key / nVertices), key % nVertices];
    lines.set(positions.subarray(3 * a, 3 * a + 3), 6 * n);
    lines.set(positions.subarray(3 * b, 3 * b + 3), 6 * n + 3);
  });
  return lines;
}

function box(positions) {
  const min = [Infinity, Infinity, Infinity];
  const max = [-Infinity, -Infinity, -Infinity];
  for (let n = 0; n < positions.length; n += 1) {
    min[n % 3] = Math.min(min[n % 3], positions[n]);
    max[n % 3] = Math.max(max[n % 3], positions[n]);
  }
  return { min, max };
}
