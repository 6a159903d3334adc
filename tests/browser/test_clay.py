"""How clay looks on the page: one smooth surface in light, with occlusion and a choice of looks, also of 100,000 samples. Started by scripts/browser-test."""

import unittest

from hapticd import CLAY
from page_case import SCREENS, SHOTS, PageCase

# Samples of a known shape in a view of the test's own, 400 × 400 pixels, without ground and axes. `shapes` gives `[[x, y, z, nx, ny, nz, r, g, b], …]`
# in metres, `parts` how many 32nds of the mean spacing they are apart; `at(point)` the colour of a point's pixel; `shown()` how many pixels have something.
STAGE = """(async () => {
  const [{ SceneView }, { parseSamples }, { clayAt, project }] = await Promise.all(["scene", "splats", "pick"].map((name) => import(`/web/${name}.js`)));
  const canvas = document.createElement("canvas");
  canvas.style = "position: fixed; left: 0; top: 0; width: 400px; height: 400px";
  document.body.append(canvas);
  const view = new SceneView(canvas, () => {});
  Object.assign(view.draw, { ground() {}, axes() {} });
  const show = (samples, spacing, parts = 0) => {
    const data = new DataView(new ArrayBuffer(32 + 20 * samples.length));
    [...new TextEncoder().encode("HCLY")].forEach((byte, n) => data.setUint8(n, byte));
    [[4, 1], [8, 1], [16, samples.length], [20, samples.length]].forEach(([at, value]) => data.setUint32(at, value, true));
    data.setFloat32(24, spacing, true);
    data.setFloat32(28, spacing / 32, true);
    samples.forEach((sample, n) => {
      const at = 32 + 20 * n;
      sample.slice(0, 3).forEach((x, axis) => data.setFloat32(at + 4 * axis, x, true));
      sample.slice(3, 6).forEach((x, axis) => data.setInt8(at + 12 + axis, Math.round(127 * x)));
      data.setUint8(at + 15, parts);
      sample.slice(6).forEach((byte, n) => data.setUint8(at + 16 + n, byte));
    });
    view.clay.clear();
    view.addClay(parseSamples(data.buffer));
    view.fit();
  };
  const ball = (n, color = [200, 200, 200]) => Array.from({ length: n }, (_, k) => {
    const z = 1 - (2 * k + 1) / n;
    const [x, y] = [Math.cos, Math.sin].map((f) => Math.sqrt(1 - z * z) * f(2.399963 * k));
    return [0.02 * x, 0.02 * y, 0.02 * z, x, y, z, ...color];
  });
  const pixels = () => {
    view.drawNow();
    const { gl } = view.draw;
    const all = new Uint8Array(4 * 400 * 400);
    gl.readPixels(0, 0, 400, 400, gl.RGBA, gl.UNSIGNED_BYTE, all);
    return all;
  };
  const at = (all, point) => {
    const [x, y] = project(view, point).map(Math.round);
    return [...all.subarray(4 * ((399 - y) * 400 + x)).subarray(0, 3)];
  };
  try {
    return await (async () => { %s })();
  } finally {
    canvas.remove();
  }
})()"""

BALL_SAMPLES = 600


class ClayTest(PageCase):
    def on_stage(self, page, script):
        return page.run(STAGE % script)

    def open_clay(self, name="clay"):
        run = self.run_scene(name, command="sculpt")
        page = self.open(run, **SCREENS["desktop-light"])
        page.wait("document.querySelector('#clay-facts').textContent.includes('samples')")
        return run, page

    def test_discs_are_blended_into_one_smooth_surface(self):
        """600 discs on a ball of 300 pixels: each covers dozens of pixels, and no rim of one is seen."""
        _, page = self.open_clay()
        row = self.on_stage(page, f"""
          show(ball({BALL_SAMPLES}), 0.02 * Math.sqrt(4 * Math.PI / {BALL_SAMPLES}));
          const all = pixels();
          return Array.from({{ length: 400 }}, (_, x) => [...all.subarray(4 * (200 * 400 + x), 4 * (200 * 400 + x) + 4)]);
        """)
        seen = [n for n, pixel in enumerate(row) if pixel[3] == 255]
        self.assertGreater(len(seen), 200, "the ball fills the view")
        self.assertEqual(len(seen), seen[-1] - seen[0] + 1, "without holes")
        tenth = len(seen) // 10
        bright = [sum(row[n][:3]) / 3 for n in seen[tenth:-tenth]]
        self.assertGreater(max(bright) - min(bright), 25, "it is lit from a side")
        # Light changes by about one in 255 from pixel to pixel; flat discs jump by ten and more.
        self.assertLess(max(abs(a - b) for a, b in zip(bright, bright[1:])), 5)
        for pixel in (row[seen[0]], row[seen[-1]]):
            self.assertGreater(pixel[3], 0)
        self.assertTrue(any(0 < pixel[3] < 255 for pixel in row), "the outline is smooth")

    def test_a_crease_is_darker(self):
        """A floor alone has the same light all over; beside a wall it gets darker toward the wall."""
        _, page = self.open_clay()
        with_wall, without = self.on_stage(page, """
          const grid = (point) => Array.from({ length: 40 }, (_, i) => Array.from({ length: 40 }, (_, j) => point(i, j))).flat();
          const floor = grid((i, j) => [0.0005 + 0.001 * i, -0.02 + 0.001 * j, 0, 0, 0, 1, 200, 200, 200]);
          const wall = grid((i, j) => [0, -0.02 + 0.001 * j, 0.0005 + 0.001 * i, 1, 0, 0, 200, 200, 200]);
          return [[...floor, ...wall], floor].map((samples) => {
            show(samples, 0.001);
            const all = pixels();
            return [0.0015, 0.03].map((x) => at(all, [x, 0, 0])[1]);
          });
        """)
        self.assertLess(abs(without[0] - without[1]), 8, f"even light: {without}")
        self.assertLess(with_wall[0], 0.9 * with_wall[1], "the crease is hidden from the sky")

    def test_the_cursor_meets_what_is_drawn(self):
        """Between samples that are four times as far apart as the mean: large discs are drawn there, and the line of sight meets them."""
        _, page = self.open_clay()
        missed, met, drawn = self.on_stage(page, """
          const floor = Array.from({ length: 100 }, (_, n) => [0.004 * (n % 10) - 0.018, 0.004 * Math.floor(n / 10) - 0.018, 0, 0, 0, 1, 200, 200, 200]);
          const under = (parts) => {
            show(floor, 0.001, parts);
            view.camera.lookFrom("top");
            const [x, y] = project(view, [0, 0, 0]);
            const { left, top } = canvas.getBoundingClientRect();
            return clayAt(view, left + x, top + y)?.point ?? null;
          };
          const [missed, met] = [under(0), under(128)];
          return [missed, met, at(pixels(), [0, 0, 0])];
        """)
        self.assertIsNone(missed)
        for found in met:
            self.assertAlmostEqual(found, 0, delta=1e-4)
        self.assertGreater(min(drawn), 60)

    def test_a_section_leaves_half_of_it_out(self):
        _, page = self.open_clay()
        whole, half = self.on_stage(page, f"""
          show(ball({BALL_SAMPLES}), 0.02 * Math.sqrt(4 * Math.PI / {BALL_SAMPLES}));
          view.camera.lookFrom("front");
          const shown = () => pixels().filter((byte, n) => n % 4 === 3 && byte > 128).length;
          const whole = shown();
          view.additions.push({{ cutOf: (role) => (role === "clay" ? [1, 0, 0, 0] : null) }});
          return [whole, shown()];
        """)
        self.assertGreater(whole, 20000)
        self.assertAlmostEqual(half, whole / 2, delta=0.06 * whole)

    def test_a_look_changes_the_colours_and_paint_keeps_its_hue(self):
        _, page = self.open_clay()
        colors = self.on_stage(page, f"""
          const found = {{}};
          for (const [name, color] of [["clay", [200, 200, 200]], ["paint", [32, 96, 224]]]) {{
            show(ball({BALL_SAMPLES}, color), 0.02 * Math.sqrt(4 * Math.PI / {BALL_SAMPLES}));
            for (const look of ["lit", "wax", "metal"]) {{
              view.clay.surface.look = look;
              found[`${{name}} ${{look}}`] = at(pixels(), [0, 0, 0]);
            }}
          }}
          return found;
        """)
        red, _, blue = colors["clay lit"]
        self.assertLess(abs(red - blue), 15, "grey clay in white light")
        red, _, blue = colors["clay wax"]
        self.assertGreater(red - blue, 40, "red wax")
        self.assertNotEqual(colors["clay metal"], colors["clay lit"])
        for look in ("lit", "wax", "metal"):
            red, _, blue = colors[f"paint {look}"]
            self.assertGreater(blue, 1.5 * red, look)

    def test_the_page_remembers_the_look(self):
        run, page = self.open_clay()
        self.assertEqual(page.run("document.querySelector('#clay-look').value"), "lit")
        wax = "#c07050"
        self.assertLess(page.count_pixels("#view", wax), 200)
        page.run("(() => { const l = document.querySelector('#clay-look'); l.value = 'wax'; l.dispatchEvent(new Event('change')); })()")
        page.wait("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")
        self.assertGreater(page.count_pixels("#view", wax), 1000)
        page.screenshot(SHOTS / "clay-wax.png")
        again = self.open(run, **SCREENS["desktop-light"])
        again.wait("document.querySelector('#clay-facts').textContent.includes('samples')")
        self.assertEqual(again.run("document.querySelector('#clay-look').value"), "wax")
        again.wait("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")
        self.assertGreater(again.count_pixels("#view", wax), 1000)

    def test_a_hundred_thousand_samples(self):
        """All are drawn, and a stroke sends the graphics card only the rows that it changed."""
        text = CLAY.replace("spacing_mm = 0.6", "spacing_mm = 0.17").replace("brush_mm = 6", "brush_mm = 2").replace('"near.csv"', '"touch.csv"')
        (self.folder / "touch.csv").write_text("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.017,0,0,0,1\n")
        (self.folder / "fine.toml").write_text(text)
        run, page = self.open_clay("fine")
        n = run.get("clay")["samples"]
        self.assertGreater(n, 90_000)
        self.assertLessEqual(n, 100_000)
        page.wait("fetch('/api/v1/clay/points').then((r) => r.arrayBuffer()).then((b) => new DataView(b).getUint32(16, true) === %d)" % n)
        page.wait("!document.querySelector('#clay-facts').textContent.includes('shown')")
        page.screenshot(SHOTS / "clay-100k.png")
        page.run("""(() => {
          const { prototype } = WebGL2RenderingContext;
          const { texSubImage2D } = prototype;
          window.sentWords = 0;
          prototype.texSubImage2D = function (...how) { window.sentWords += how[4] * how[5]; return texSubImage2D.apply(this, how); };
        })()""")
        version = run.get("clay")["version"]
        page.click("#clay-crafts button[value=emboss]")
        page.wait("document.querySelector('#clay-crafts button[value=emboss]').getAttribute('aria-pressed') === 'true'")
        page.run("document.querySelector('#clay-hold').focus()")
        page.hold_key(" ", True)
        page.wait("document.querySelector('#clay-hold').getAttribute('aria-pressed') === 'true'")
        page.wait("fetch('/api/v1/clay').then((r) => r.json()).then(({ is_held }) => is_held)")
        page.hold_key(" ", False)
        page.wait("document.querySelector('#clay-undo').textContent === 'Undo (1)'")
        page.wait("window.sentWords > 0")
        self.assertGreater(run.get("clay")["version"], version)
        self.assertEqual(run.get("clay")["samples"], n)
        self.assertLess(page.run("window.sentWords"), 5 * n / 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
