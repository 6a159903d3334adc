/** Fetches meshes and has them made ready by the worker, one after the other. */

export class MeshLoader {
  /** @param {import("./link.js").Link} link */
  constructor(link) {
    this.link = link;
    this.worker = new Worker(new URL("./mesh-worker.js", import.meta.url), { type: "module" });
    this.nextId = 1;
    this.waiting = new Map();
    this.worker.onmessage = ({ data: { id, made, error } }) => {
      const { resolve, reject } = this.waiting.get(id);
      this.waiting.delete(id);
      if (error) reject(new Error(error));
      else resolve(made);
    };
  }

  /** @param {string} path @param {boolean} isThinned @returns {Promise<import("./mesh.js").Mesh>} */
  async load(path, isThinned) {
    return this.#prepare({ bytes: await this.link.getBytes(path), isThinned });
  }

  /** Faces of voxels or points, which the server bakes first. @param {string} path @param {"voxels"|"points"} marks @returns {Promise<import("./marks.js").Marks>} */
  async loadMarks(path, marks) {
    const file = await this.link.getFile(path);
    return this.#prepare({ bytes: await file.arrayBuffer(), marks });
  }

  #prepare(asked) {
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.worker.postMessage({ id, ...asked }, [asked.bytes]);
    });
  }
}
