/** Makes meshes ready beside the page, so that its buttons answer while a large scene loads. */

import { parse, prepare } from "./mesh.js";

self.onmessage = ({ data: { id, bytes, isThinned } }) => {
  try {
    const mesh = prepare(parse(bytes), isThinned);
    self.postMessage({ id, mesh }, [mesh.positions.buffer, mesh.normals.buffer, mesh.edges.buffer]);
  } catch (error) {
    self.postMessage({ id, error: error.message });
  }
};
