/** Meshes of arrows, along z, with a width and a length of 1, and of the brush. */

const SIDES = 24;

/**
 * A body of rotation about z.
 * @param {number[][]} profile [radius, z] from one end to the other, each stretch with faces of its own
 * @returns {{positions: Float32Array, normals: Int8Array}} three corners per triangle
 */
function lathe(profile) {
  const positions = [];
  const normals = [];
  for (let n = 0; n + 1 < profile.length; n += 1) {
    const [[r0, z0], [r1, z1]] = [profile[n], profile[n + 1]];
    const slope = Math.hypot(r1 - r0, z1 - z0);
    const [out, up] = [(z1 - z0) / slope, (r0 - r1) / slope];
    for (let side = 0; side < SIDES; side += 1) {
      const [a, b] = [side, side + 1].map((k) => (2 * Math.PI * k) / SIDES);
      const corner = (r, z, angle) => {
        positions.push(r * Math.cos(angle), r * Math.sin(angle), z);
        normals.push(127 * out * Math.cos(angle), 127 * out * Math.sin(angle), 127 * up, 0);
      };
      corner(r0, z0, a);
      corner(r0, z0, b);
      corner(r1, z1, b);
      corner(r0, z0, a);
      corner(r1, z1, b);
      corner(r1, z1, a);
    }
  }
  return { positions: new Float32Array(positions), normals: Int8Array.from(normals, Math.round) };
}

/** A closed rod from z = 0 to 1. */
export const rod = () => lathe([[0, 0], [1, 0], [1, 1], [0, 1]]);

/** A closed cone from its base at z = 0 to its tip at 1. */
export const cone = () => lathe([[0, 0], [1, 0], [0, 1]]);

/** A flat ring with a radius of 1 around z, a strip of triangles: `[3 × corners]`. @param {number} width */
export function ring(width) {
  const corners = [];
  for (let side = 0; side <= 4 * SIDES; side += 1) {
    const angle = (2 * Math.PI * side) / (4 * SIDES);
    for (const radius of [1 - width, 1]) corners.push(radius * Math.cos(angle), radius * Math.sin(angle), 0);
  }
  return new Float32Array(corners);
}
