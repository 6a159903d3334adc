/** Fetches meshes and has them made ready by the worker, one after the other. */

export class MeshLoader {
  /** @param {import("./link.js").Link} link */
  constructor(link) {
    this.link = link;
    this.worker = new Worker(new URL("./mesh-worker.js", import.meta.url), { type: "module" });
    this.nextId = 1;
    this.waiting = new Map();
    this.worker.onmessage = ({ data: { id, mesh, error } }) => {
      const { resolve, reject } = this.waiting.get(id);
      this.waiting.delete(id);
      if (error) reject(new Error(error));
      else resolve(mesh);
    };
  }

  /** @param {string} path @param {boolean} isThinned @returns {Promise<import("./mesh.js").Mesh>} */
  async load(path, isThinned) {
    const bytes = await this.link.getBytes(path);
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.worker.postMessage({ id, bytes, isThinned }, [bytes]);
    });
  }
}
