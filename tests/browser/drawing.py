"""Measures how long the page takes to draw clay: samples on a ball, in a view of its own, with the page's own modules and no program behind it.

    python3 tests/browser/drawing.py [--json] [--web DIR] [--size WIDTHxHEIGHT] [--rounds N] [SAMPLES...]

Prints for each number of samples the pictures that the browser makes in a second while the camera turns, and the times of one in full and of one where only the tool
has moved. Times depend on what else the machine does: `chrt -r 50 python3 tests/browser/drawing.py` as root keeps other work away."""

import argparse
import contextlib
import functools
import http.server
import json
import pathlib
import statistics
import threading

from chromium import Chromium

WEB = pathlib.Path(__file__).resolve().parents[2] / "src" / "monitor" / "web"
# A page with a view alone: what belongs to no run of the program.
PAGE = b"""<!doctype html><title>drawing</title><link rel="stylesheet" href="/web/style.css"><link rel="icon" href="data:,">
<canvas id="view" style="position: fixed; left: 0; top: 0"></canvas>"""

STAGE = """(async () => {
  const [{ SceneView }, { parseSamples }] = await Promise.all(["scene", "splats"].map((name) => import(`/web/${name}.js`)));
  const canvas = document.querySelector("#view");
  Object.assign(canvas.style, { width: "%(width)dpx", height: "%(height)dpx" });
  const view = new SceneView(canvas, () => {});
  window.view = view;
  const n = %(n)d;
  const data = new DataView(new ArrayBuffer(32 + 20 * n));
  [...new TextEncoder().encode("HCLY")].forEach((byte, at) => data.setUint8(at, byte));
  [[4, 1], [8, 1], [16, n], [20, n]].forEach(([at, value]) => data.setUint32(at, value, true));
  const spacing = 0.02 * Math.sqrt(4 * Math.PI / n);
  data.setFloat32(24, spacing, true);
  data.setFloat32(28, spacing / 32, true);
  // In no order, as those of a piece.
  const order = Uint32Array.from({ length: n }, (_, k) => k);
  for (let k = n - 1, seed = 1; k > 0; k -= 1) {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    const other = seed %% (k + 1);
    [order[k], order[other]] = [order[other], order[k]];
  }
  order.forEach((k, row) => {
    const z = 1 - (2 * k + 1) / n;
    const normal = [Math.sqrt(1 - z * z) * Math.cos(2.399963229728653 * k), Math.sqrt(1 - z * z) * Math.sin(2.399963229728653 * k), z];
    const at = 32 + 20 * row;
    normal.forEach((x, axis) => data.setFloat32(at + 4 * axis, 0.02 * x, true));
    normal.forEach((x, axis) => data.setInt8(at + 12 + axis, Math.round(127 * x)));
    data.setUint8(at + 15, 32);
    [200, 180, 160].forEach((byte, at_byte) => data.setUint8(at + 16 + at_byte, byte));
  });
  view.addClay(parseSamples(data.buffer));
  view.fit();
  view.drawNow();
})()"""

# Waits for all that was drawn: what is read has to be there.
DONE = "view.draw.gl.readPixels(0, 0, 1, 1, view.draw.gl.RGBA, view.draw.gl.UNSIGNED_BYTE, new Uint8Array(4));"

# Pictures a second.
TURNING = """new Promise((end) => {
  const from = performance.now();
  let [pictures, first] = [0, 0];
  view.onDrawn = () => {
    const now = performance.now();
    // The first ones find out how long they take.
    if (now - from < 1000) first = now;
    else pictures += 1;
    if (now - from > 1000 + %d) {
      view.onDrawn = () => {};
      end((pictures * 1000) / (now - first));
    } else view.camera.orbit(0.02, 0);
  };
  view.camera.orbit(0.02, 0);
})"""
# In full, and once more where nothing has changed but the tool: the light on the clay is there.
STILL = """(async () => {
  const timed = async (before) => {
    const took = [];
    for (let n = 0; n < 5; n += 1) {
      await new Promise(requestAnimationFrame);
      before();
      %s
      const begun = performance.now();
      view.drawNow();
      %s
      took.push(performance.now() - begun);
    }
    return took.sort((a, b) => a - b)[2];
  };
  return [await timed(() => view.camera.orbit(0.02, 0)), await timed(() => {})];
})()""" % (DONE, DONE)


@contextlib.contextmanager
def served(web=WEB):
    """The address of a page with nothing but a view, and the page's modules."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Files, directory=str(web))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


class Files(http.server.SimpleHTTPRequestHandler):
    """The page's modules below `/web/`, and a page with nothing but a view."""

    extensions_map = http.server.SimpleHTTPRequestHandler.extensions_map | {".js": "text/javascript"}

    def log_message(self, *_):
        pass

    def do_GET(self):
        if self.path != "/":
            self.path = self.path.removeprefix("/web")
            return super().do_GET()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(PAGE)


def measure(browser, url, n, size, seconds):
    page = browser.open(url, width=max(size[0], 200), height=max(size[1], 200))
    page.run(STAGE % {"n": n, "width": size[0], "height": size[1]})
    turning_per_s = page.run(TURNING % (1000 * seconds))
    drawn, share = page.run("[view.clay.surface.drawn, view.clay.share]")
    full_ms, tool_ms = page.run(STILL)
    found = {"samples": n, "turning_per_s": turning_per_s, "drawn": drawn, "share": share, "full_ms": full_ms, "tool_ms": tool_ms}
    if complaints := page.complaints():
        raise SystemExit("\n".join(complaints))
    page.close()
    return found


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("samples", nargs="*", type=int, default=[1000, 20_000, 100_000])
    arguments.add_argument("--json", action="store_true")
    arguments.add_argument("--web", type=pathlib.Path, default=WEB, help="the page's modules, such as those of another version")
    arguments.add_argument("--size", default="1000x620", help="of the view, pixels")
    arguments.add_argument("--rounds", type=int, default=3)
    given = arguments.parse_args()
    size = [int(side) for side in given.size.split("x")]
    with served(given.web) as url, Chromium() as browser:
        for n in given.samples:
            rounds = [measure(browser, url, n, size, 2) for _ in range(given.rounds)]
            found = {name: statistics.median(one[name] for one in rounds) for name in rounds[0]}
            if given.json:
                print(json.dumps(found), flush=True)
            else:
                print("{samples} samples: {turning_per_s:.1f} pictures a second while it turns ({drawn} nodes, {share:.1f} of the resolution); {full_ms:.0f} ms for one in full, {tool_ms:.0f} ms where only the tool moves".format(**found), flush=True)


if __name__ == "__main__":
    main()
