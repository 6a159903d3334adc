/** Makes meshes and marks ready beside the page, so that its buttons answer while a large scene loads. */

import { unfold } from "./marks.js";
import { parse, prepare } from "./mesh.js";

self.onmessage = ({ data: { id, bytes, isThinned, marks } }) => {
  try {
    const made = marks ? unfold(bytes, marks) : prepare(parse(bytes), isThinned);
    const { positions, normals } = made.mesh ?? made;
    self.postMessage({ id, made }, [positions.buffer, normals.buffer, (made.tints ?? made.edges).buffer]);
  } catch (error) {
    self.postMessage({ id, error: error.message });
  }
};
