"""How clay looks on the page: one smooth surface in light, with occlusion and a choice of looks, also of 100,000 samples. Started by scripts/browser-test."""

import json
import unittest

from drawing import served
from hapticd import CLAY
from page_case import DRAWN, SCREENS, SHOTS, PageCase

# Samples of a known shape in a view of the test's own, 400 × 400 pixels, without ground and axes. `shapes` gives `[[x, y, z, nx, ny, nz, r, g, b], …]`
# in metres, `parts` how many 32nds of the mean spacing they are apart; `at(point)` the colour of a point's pixel; `shown()` how many pixels have something.
STAGE = """(async () => {
  const [{ SceneView }, { parseSamples }, { clayAt, project }] = await Promise.all(["scene", "splats", "pick"].map((name) => import(`/web/${name}.js`)));
  const canvas = document.querySelector("#view");
  Object.assign(canvas.style, { width: "400px", height: "400px" });
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
  return await (async () => { %s })();
})()"""

BALL_SAMPLES = 600


class ClayTest(PageCase):
    def on_stage(self, script):
        """What a script finds in a view of its own: no run is behind it."""
        page = self.browser.open(self.enterContext(served()))
        self.addCleanup(page.close)
        found = page.run(STAGE % script)
        self.assertEqual(page.complaints(), [], "the console is clean")
        return found

    def open_clay(self, name="clay"):
        run = self.run_scene(name, command="sculpt")
        page = self.open(run, **SCREENS["desktop-light"])
        page.wait("document.querySelector('#clay-facts').textContent.includes('samples')")
        return run, page

    def test_discs_are_blended_into_one_smooth_surface(self):
        """600 discs on a ball of 300 pixels: each covers dozens of pixels, and no rim of one is seen."""
        row = self.on_stage(f"""
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
        with_wall, without = self.on_stage("""
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
        missed, met, drawn = self.on_stage("""
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
        whole, half = self.on_stage(f"""
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
        colors = self.on_stage(f"""
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

    def test_samples_are_discs_sprites_or_spheres_too(self):
        """40 samples on a ball: as spheres each has a bright side; as discs and sprites it is one colour; between them the ground is seen."""
        found = self.on_stage("""
          const [found, kept] = [{}, {}];
          for (const form of ["surface", "discs", "sprites", "spheres"]) {
            show(ball(40), 0.02 * Math.sqrt(4 * Math.PI / 40));
            view.clay.surface.form = form;
            const all = pixels();
            const shown = all.filter((byte, n) => n % 4 === 3 && byte > 128).length;
            const tones = new Set();
            for (let n = 0; n < all.length; n += 4) if (all[n + 3] > 250) tones.add(all[n] >> 2);
            found[form] = [shown, tones.size];
            kept[form] = all;
          }
          found.differ = kept.spheres.reduce((n, byte, at) => n + (at % 4 === 0 && Math.abs(byte - kept.sprites[at]) > 12), 0);
          return found;
        """)
        self.assertGreater(found.pop("differ"), 5000, "a sphere is round in the light")
        covered = {form: shown for form, (shown, _) in found.items()}
        self.assertLess(covered["discs"], 0.8 * covered["surface"], f"there are gaps between discs: {found}")
        self.assertGreater(covered["sprites"], 1.2 * covered["discs"], f"sprites face the eye: {found}")
        self.assertEqual(covered["spheres"], covered["sprites"])

    def test_a_far_pattern_is_even(self):
        """A plate whose samples are black and white in turn, less than a pixel apart: grey without a pattern, from above and at a flat angle, where only the low-pass
        filter of the splats joins what is between two rows of pixels."""
        found = self.on_stage("""
          const side = 160;
          const plate = Array.from({ length: side * side }, (_, n) => {
            const [i, j] = [n % side, Math.floor(n / side)];
            return [1e-4 * (i - side / 2), 1e-4 * (j - side / 2), 0, 0, 0, 1, ...Array(3).fill((i + j) % 2 ? 235 : 20)];
          });
          show(plate, 1e-4);
          const { gl } = view.draw;
          const { uniform1f } = WebGL2RenderingContext.prototype;
          const spread = (isFiltered) => {
            const filters = Object.values(view.clay.surface.programs).map((program) => program.at.low_pass);
            gl.uniform1f = (at, x) => uniform1f.call(gl, at, at && filters.includes(at) && !isFiltered ? 0 : x);
            view.clay.surface.made = "";
            const all = pixels();
            const seen = [];
            for (let n = 0; n < 4 * 400 * 400; n += 4) if (all[n + 3] === 255) seen.push([(n / 4) % 400, Math.floor(n / 1600), all[n]]);
            const [left, right, low, high] = [0, 0, 1, 1].map((axis, k) => Math[k % 2 ? "max" : "min"](...seen.map((pixel) => pixel[axis])));
            const isInner = ([x, y]) => x > 0.7 * left + 0.3 * right && x < 0.3 * left + 0.7 * right && y > 0.7 * low + 0.3 * high && y < 0.3 * low + 0.7 * high;
            const tones = seen.filter(isInner).map((pixel) => pixel[2]);
            return [tones.length, Math.max(...tones) - Math.min(...tones)];
          };
          pixels();
          return [[1.5, 0.1], [0.9, 0.13], [0.1, 0.06], [0.05, 0.05], [0.03, 0.04]].map(([tilt, distance]) => {
            [view.camera.turn, view.camera.tilt] = [0.3, tilt];
            view.camera.lookAt([0, 0, 0], distance);
            return [tilt, ...spread(true), ...spread(false)];
          });
        """)
        for tilt, n, spread, n_bare, bare in found:
            # 5 to 9 of 255 were measured with the filter, and 25 to 59 without.
            self.assertGreater(min(n, n_bare), 300, found)
            self.assertLess(spread, 12, f"at {tilt} rad over the plate: {found}")
            self.assertGreater(bare, 20, f"the pattern is there without the filter: {found}")

    def test_detail_follows_the_camera(self):
        """Samples that are drawn: all of them near, fewer by the square of the distance far away, and none of what is beside the picture."""
        n = 40_000
        drawn, colors = self.on_stage(f"""
          show(ball({n}), 0.02 * Math.sqrt(4 * Math.PI / {n}), 32);
          const [drawn, colors] = [[], []];
          // The eye is 2 mm over the ball, and then so far away that the ball has 14 pixels.
          for (const distance of [0.022, 0.1, 0.4, 0.8, 1.6]) {{
            view.camera.lookFrom("front");
            view.camera.lookAt([0, 0, 0], distance);
            colors.push(at(pixels(), [0, 0, 0]));
            drawn.push(view.clay.surface.drawn);
          }}
          return [drawn, colors];
        """)
        near, whole, larger, half, quarter = drawn
        self.assertLess(near, n / 2, "what is beside the picture is left out")
        self.assertEqual([whole, larger], [n, n], "samples are a pixel apart, or nearly")
        self.assertTrue(n / 5 < half < n / 2.5, drawn)
        self.assertTrue(n / 20 < quarter < n / 8, drawn)
        for color in colors[:4]:
            for a, b in zip(color, colors[0]):
                self.assertAlmostEqual(a, b, delta=6, msg=f"means look like what they are of: {colors}")
        # Along a plate in one picture: near blocks in full, farther ones coarser, each once.
        levels, n_first, n_nodes, blocks = self.on_stage("""
          const { cutOf, levelsOf } = await import("/web/lod.js");
          const plate = Array.from({ length: 40_000 }, (_, n) => [1e-3 * (n % 400), 1e-3 * Math.floor(n / 400), 0, 0, 0, 1, 9, 9, 9]);
          show(plate, 1e-3, 32);
          const { levels } = view.clay;
          const cut = cutOf(levels, ([x]) => 1000 / (1 + 20 * x), 1e-3, 1);
          const counts = cut.map((ranges) => ranges.reduce((sum, [first, end]) => sum + end - first, 0));
          const covered = levels.blocks.flatMap(({ ranges: [[first, end]] }) => [first, end]);
          return [counts.filter((n) => n > 0).length, counts[0], counts.reduce((sum, n) => sum + n), [covered[0], covered.at(-1), covered.slice(1, -1).every((edge, n, all) => n % 2 || edge === all[n + 1])]];
        """)
        self.assertGreaterEqual(levels, 3)
        self.assertTrue(0 < n_first < 0.2 * n, n_first)
        self.assertLess(n_nodes, n / 3)
        self.assertEqual(blocks, [0, n, True])

    def test_the_mass_points_are_a_view_and_the_page_remembers_how_samples_are_drawn(self):
        run, page = self.open_clay()
        raster = run.get("clay")["raster"]
        drawn = """(() => {
          const { prototype } = WebGL2RenderingContext;
          const { drawArrays } = prototype;
          window.linesDrawn = 0;
          prototype.drawArrays = function (mode, first, n) { if (mode === this.LINES) window.linesDrawn = Math.max(window.linesDrawn, n); return drawArrays.call(this, mode, first, n); };
        })()"""
        page.run(drawn)
        page.run("document.querySelector('#clay-grid').click()")
        x, y, z = raster
        page.wait(f"window.linesDrawn === {2 * (x * y + y * z + z * x)}")
        page.screenshot(SHOTS / "clay-grid.png")
        page.run("(() => { const f = document.querySelector('#clay-form'); f.value = 'spheres'; f.dispatchEvent(new Event('change')); })()")
        page.wait(DRAWN)
        page.screenshot(SHOTS / "clay-spheres.png")
        page.close()
        again = self.open(run, **SCREENS["desktop-light"])
        again.wait("document.querySelector('#clay-facts').textContent.includes('samples')")
        self.assertEqual(again.run("[document.querySelector('#clay-form').value, document.querySelector('#clay-grid').checked]"), ["spheres", True])

    def test_the_page_remembers_the_look(self):
        run, page = self.open_clay()
        self.assertEqual(page.run("document.querySelector('#clay-look').value"), "lit")
        wax = "#c07050"
        self.assertLess(page.count_pixels("#view", wax), 200)
        page.run("(() => { const l = document.querySelector('#clay-look'); l.value = 'wax'; l.dispatchEvent(new Event('change')); })()")
        page.wait(DRAWN)
        self.assertGreater(page.count_pixels("#view", wax), 1000)
        page.screenshot(SHOTS / "clay-wax.png")
        page.close()
        again = self.open(run, **SCREENS["desktop-light"])
        again.wait("document.querySelector('#clay-facts').textContent.includes('samples')")
        self.assertEqual(again.run("document.querySelector('#clay-look').value"), "wax")
        again.wait(DRAWN)
        self.assertGreater(again.count_pixels("#view", wax), 1000)

    def test_curves_region_material_and_files_are_chosen_by_numbers(self):
        run, page = self.open_clay()
        click = lambda name: page.run(f"document.querySelector('#clay-{name}').click()")
        write = lambda name, text: page.run(f"((field) => {{ field.value = {json.dumps(text)}; field.dispatchEvent(new Event('input')); }})(document.querySelector('#clay-{name}'))")
        facts = lambda condition: page.wait(f"fetch('/api/v1/clay').then((r) => r.json()).then((facts) => {condition})")
        page.run("document.querySelector('#clay-numbers').open = true")
        top_mm = 15.0
        page.click("#clay-crafts button[value=pull-curve]")
        facts("facts.craft === 'pull-curve'")
        write("curves", f"-3 0 {top_mm}\n3 0 {top_mm}\n\n0 -3 {top_mm}\n0 3 {top_mm}")
        click("draw")
        facts("facts.curves_map.length === 2")
        page.wait("document.querySelector('#clay-drawn').textContent === '2 curves are drawn.'")
        page.screenshot(SHOTS / "clay-curves.png")
        click("pull")
        facts("facts.undo === 1 && !facts.is_stroke")
        write("lay-stiffness-n-per-m", "321")
        click("lay")
        facts("facts.undo === 2 && facts.material.stiffness_n_per_m === 321")
        write("region-least", "-6 -6 8")
        write("region-most", "6, 6, 20")
        click("choose")
        facts("facts.region_map.min[0] > -0.007")
        page.run("""(() => {
          const mesh = "v 0 0 0\\nv 6 0 0\\nv 0 6 0\\nv 0 0 6\\nf 1 3 2\\nf 1 2 4\\nf 1 4 3\\nf 2 3 4\\n";
          const files = new DataTransfer();
          files.items.add(new File([mesh], "corner.obj"));
          const input = document.querySelector("#clay-solid");
          input.files = files.files;
          input.dispatchEvent(new Event("change"));
        })()""")
        facts("facts.solid === '4 triangles, 6.0 x 6.0 x 6.0 mm'")
        page.wait("document.querySelector('#clay-tool-files').textContent.includes('4 triangles')")
        click("no-solid")
        facts("facts.solid === null")
        # What makes no sense is said in words, and changes nothing.
        write("curves", "1 2")
        click("draw")
        page.wait("document.body.textContent.includes('is not three numbers x y z in mm')")
        self.assertEqual(run.get("clay")["undo"], 2)
        page.run("document.querySelector('#clay-numbers').scrollIntoView()")
        page.screenshot(SHOTS / "clay-numbers.png")

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
        self.hold_by_key(run, page)
        page.hold_key(" ", False)
        page.wait("document.querySelector('#clay-undo').textContent === 'Undo (1)'")
        page.wait("window.sentWords > 0")
        self.assertGreater(run.get("clay")["version"], version)
        # An image adds samples where it is steep.
        self.assertGreaterEqual(run.get("clay")["samples"], n)
        self.assertLess(page.run("window.sentWords"), 5 * n / 2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
