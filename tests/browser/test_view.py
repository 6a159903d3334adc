"""What looks more closely at the picture and keeps what is seen: section plane, measuring, exports, recordings. Started by scripts/browser-test."""

import base64
import json
import re
import struct
import time
import unittest
import urllib.error
import urllib.request

from chromium import COUNT_PIXELS
from page_case import DRAWN, IN_CONTACT, SCREENS, SHOTS, PageCase, number

# Closed parts of known size: the block reaches to z = 10 mm, the tool hangs above it.
BLOCK = """
version = 1
name = "block scene"

[[static]]
name = "block"
shape = { box_mm = [60.0, 40.0, 20.0] }
voxel_size_mm = 1.0

[tool]
shape = { box_mm = [10.0, 10.0, 20.0] }
voxel_size_mm = 1.0
mass_g = 100.0
start_position_mm = [0.0, 0.0, 25.0]

[contact]
stiffness_n_per_mm3 = 5.0

[device]
profile = "sim-sigma7"
hand = "above.csv"
"""

# Where points of world are in the window, with a camera of the test's own that looks as the page's does after `Top` and `Fit`.
PROJECT = """(async () => {
  const { OrbitCamera } = await import('/web/camera.js');
  const { project } = await import('/web/pick.js');
  const canvas = document.createElement('canvas');
  const box = document.querySelector('#view').getBoundingClientRect();
  Object.defineProperties(canvas, { clientWidth: { value: box.width }, clientHeight: { value: box.height } });
  const camera = new OrbitCamera(canvas, () => {});
  const [min, max] = [[-0.03, -0.02, -0.01], [0.03, 0.02, 0.035]];
  camera.subject = { min, max, middle: [0, 0, 0.0125], radius: Math.hypot(0.06, 0.04, 0.045) / 2 };
  camera.lookFrom('top');
  camera.fit();
  return %s.map((point) => project({ canvas, camera }, point)).map(([x, y]) => [box.left + x, box.top + y]);
})()"""


class ViewTest(PageCase):
    @staticmethod
    def write_scenes(folder):
        PageCase.write_scenes(folder)
        (folder / "block.toml").write_text(BLOCK)
        (folder / "above.csv").write_text("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.025,0,0,0,1\n")

    def open_url(self, url, complains=False, **screen):
        page = super().open_url(url, complains, **screen)
        # Where a busy machine sends nothing for a second, the page greys the picture and moves it down: not what these tests are about.
        rule = "#lost { display: none } .is-stale .picture { opacity: 1; filter: none }"
        page.run(f"(() => {{ const sheet = new CSSStyleSheet(); sheet.replaceSync({json.dumps(rule)}); document.adoptedStyleSheets = [sheet]; }})()")
        return page

    def open_block(self, **screen):
        run = self.run_scene("block")
        page = self.open(run, **screen)
        return run, page

    def click_at(self, page, point, off=(0, 0)):
        """A click where a point of world is seen from above, or some pixels off."""
        page.click("[data-view=fit]")
        ((x, y),) = page.run(PROJECT % f"[{point}]")
        page.drag((x + off[0], y + off[1]), (x + off[0], y + off[1]))
        page.wait(DRAWN)

    def write(self, page, selector, text):
        """As someone types: selects all, types, and leaves the field by Enter."""
        page.run(f"(() => {{ const f = document.querySelector('{selector}'); f.scrollIntoView({{ block: 'nearest' }}); f.focus(); f.select(); }})()")
        page.call("Input.insertText", text=text)
        page.press("Enter")
        page.run("document.activeElement.blur()")

    def test_section(self):
        """Part, tool, axis, place and side of the plane are seen in the picture."""
        _, page = self.open_block()
        cut = lambda: (page.wait(DRAWN), page.count_pixels("#view", "--cut-part"))[1]
        self.assertEqual(cut(), 0, "nothing is cut before")
        self.assertEqual(page.run("document.querySelector('#legend-contacts').textContent"), "contacts")
        page.click("#section")
        whole = cut()
        self.assertGreater(whole, 3000, "the block has a cut face")
        self.assertGreater(page.count_pixels("#view", "--cut-tool"), 1000, "and so has the tool")
        page.screenshot(SHOTS / "section.png")
        page.click("#section-tool")
        page.wait(DRAWN)
        with_tool_whole = page.picture_of("#view")
        self.assertGreater(page.count_pixels("#view", "--tool"), 1000)
        page.click("#section-tool")
        page.wait(DRAWN)
        self.assertNotEqual(page.picture_of("#view"), with_tool_whole)

        # Beyond the block there is nothing to cut.
        self.write(page, "#section-place", "20,5")
        self.assertEqual(page.run("document.querySelector('#section-place').value"), "20.5")
        self.assertEqual(cut(), 0)
        page.run("(() => { const s = document.querySelector('#section-slider'); s.value = 500; s.dispatchEvent(new Event('input')); })()")
        self.assertAlmostEqual(cut(), whole, delta=0.02 * whole)
        # Where it cannot go is said, and it stays.
        self.write(page, "#section-place", "70")
        self.assertEqual(page.run("document.querySelector('#section-problem').textContent"), "70 is out of range: -24 to 24 mm")
        self.assertAlmostEqual(cut(), whole, delta=0.02 * whole)

        # Across z the face is as large as the block from above, and larger than across x.
        page.click("[data-view=top]")
        page.click("[data-axis='2']")
        self.write(page, "#section-place", "0")
        flat = cut()
        self.assertGreater(flat, 10000)
        page.click("#section-flip")
        self.assertEqual(cut(), 0, "from the other side it is behind the block")
        page.click("#section")
        self.assertEqual(cut(), 0)
        self.assertTrue(page.run("document.querySelector('#section-box').hidden"))

    def handle(self, page):
        """Middle of the handle of the section plane in the window, and its direction there."""
        page.wait(DRAWN)
        return page.run(
            """(() => {
              const handle = document.querySelector('#section-handle');
              const { a, b, e, f } = handle.getScreenCTM();
              return [[e, f], [a / Math.hypot(a, b), b / Math.hypot(a, b)]];
            })()"""
        )

    def test_the_handle_moves_the_plane(self):
        """By mouse and by finger, as far as the cursor goes along it, and the view stays as it is."""
        for name in ("desktop-dark", "phone"):
            with self.subTest(name):
                _, page = self.open_block(**SCREENS[name])
                self.assertEqual(page.run("getComputedStyle(document.querySelector('#section-handle')).display"), "none")
                page.click("#section")
                before, way = self.handle(page)
                place = lambda: float(page.run("document.querySelector('#section-place').value"))
                self.assertAlmostEqual(place(), 0, places=2)
                tips = "[...document.querySelectorAll('.axes span')].map((tip) => tip.style.cssText)"
                stood = page.run(tips)
                # Away from the line of the handle, which takes of the way what is along it.
                goal = [before[0] + 50 * way[0] - 8 * way[1], before[1] + 50 * way[1] + 8 * way[0]]
                middle = [(a + b) / 2 for a, b in zip(before, goal)]
                if name == "phone":
                    page.touch("Start", before)
                    page.touch("Move", middle)
                    page.touch("Move", goal)
                else:
                    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=before[0], y=before[1])
                    page.wait("getComputedStyle(document.querySelector('#section-handle')).opacity === '1'")
                    page.call("Input.dispatchMouseEvent", type="mousePressed", x=before[0], y=before[1], button="left", buttons=1, clickCount=1)
                    for x, y in (middle, goal):
                        page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)
                    self.assertEqual(page.run("getComputedStyle(document.querySelector('#section-handle')).cursor"), "grabbing")
                after, _ = self.handle(page)
                page.screenshot(SHOTS / f"section-handle-{name}.png")
                self.assertAlmostEqual(after[0], before[0] + 50 * way[0], delta=2.5)
                self.assertAlmostEqual(after[1], before[1] + 50 * way[1], delta=2.5)
                self.assertGreater(place(), 3)
                # No farther than the slider.
                far = [before[0] + 900 * way[0], before[1] + 900 * way[1]]
                if name == "phone":
                    page.touch("Move", far)
                    page.touch("End")
                else:
                    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=far[0], y=far[1], button="left", buttons=1)
                    page.call("Input.dispatchMouseEvent", type="mouseReleased", x=far[0], y=far[1], button="left", clickCount=1)
                page.wait(DRAWN)
                self.assertEqual(place(), 24)
                self.assertEqual(page.run("document.querySelector('#section-slider').value"), "1000")
                self.assertEqual(page.run(tips), stood, "the view does not turn")
                # A drag along the line of sight would say nothing.
                page.click("[data-view=top]")
                page.click("#section-box [data-axis='2']")
                page.wait("getComputedStyle(document.querySelector('#section-handle')).display === 'none'")
                page.close()

    def test_contacts_that_are_cut_away(self):
        """Dots are points of the tool, and go with it."""
        # So few that all are shown.
        coarse = (self.folder / "press.toml").read_text().replace("voxel_size_mm = 1.5", "voxel_size_mm = 2")
        (self.folder / "coarse.toml").write_text(coarse)
        run = self.run_scene("coarse")
        page = self.open(run)
        page.wait(IN_CONTACT)
        legend = "document.querySelector('#legend-contacts').textContent"
        page.wait(f"{legend} === 'contacts'")
        page.click("#section")
        page.wait(f"{legend}.endsWith(' points shown')")
        shown, all = page.run(f"{legend}.match(/\\d+/g).map(Number)")
        self.assertTrue(0.3 * all < shown < 0.7 * all, "the plane goes through the middle of the tool")
        page.screenshot(SHOTS / "section-contacts.png")
        page.click("#section-tool")
        page.wait(f"{legend} === 'contacts'")
        page.click("#section-tool")
        page.wait(f"{legend}.endsWith(' points shown')")
        # The eye is at negative y: all of the tool is on the side that is left out, then none of it.
        self.write(page, "#section-place", "29")
        page.wait(f"{legend}.startsWith('0 of ')")
        page.click("#section-flip")
        page.wait(f"{legend} === 'contacts'")

    def test_measuring(self):
        run, page = self.open_block()
        answer = "document.querySelector('#measure-answer').textContent"
        page.click("[data-view=top]")
        page.click("[data-view=fit]")
        page.click("#measure")
        self.click_at(page, [0.03, -0.02, 0.01])
        self.assertEqual(page.run(answer), "Click a second point")
        # Near a corner is at the corner.
        self.click_at(page, [-0.03, -0.02, 0.01], (4, -3))
        self.assertEqual(page.run(answer), "60.000 mm (x 60.000, y 0.000, z 0.000 mm)")
        self.click_at(page, [-0.03, 0.02, 0.01])
        self.assertEqual(page.run(answer), "60.000 mm, 40.000 mm, 90.00°")
        self.assertEqual(page.run("[...document.querySelectorAll('#measure-labels li')].map((label) => label.textContent)"), ["60.000 mm", "40.000 mm", "90.00°"])
        self.assertGreater(page.count_pixels("#view", "--measure"), 200, "lines")
        page.screenshot(SHOTS / "measure.png")
        # A drag turns the view, and what was measured stays.
        x, y = page.middle_of("#view")
        page.drag((x, y), (x + 60, y + 40))
        page.wait(DRAWN)
        self.assertEqual(page.run(answer), "60.000 mm, 40.000 mm, 90.00°")
        page.press("Escape")
        page.wait(DRAWN)
        self.assertEqual(page.run(answer), "Click a first point")
        self.assertEqual(page.count_pixels("#view", "--measure"), 0)

        # On a face, not at a corner; and beside all parts.
        page.click("[data-view=top]")
        page.click("[data-view=fit]")
        self.click_at(page, [-0.02, 0.01, 0.01])
        self.click_at(page, [-0.03, 0.02, 0.01])
        self.assertRegex(page.run(answer), r"^14\.[01]\d\d mm \(x (9\.9|10\.0)\d\d, y (9\.9|10\.0)\d\d, z 0\.000 mm\)$")
        self.click_at(page, [0.0, -0.03, 0.0])
        self.assertEqual(page.run(answer), "There is nothing at that place")

        # What was cut away cannot be met: through the plane at z = 0 lies the cut face.
        page.press("Escape")
        self.click_at(page, [-0.02, 0.01, 0.01])
        page.click("#section")
        page.click("[data-axis='2']")
        self.write(page, "#section-place", "0")
        self.click_at(page, [-0.02, -0.01, 0.0])
        self.assertRegex(page.run(answer), r" mm \(x 0\.\d+, y (19\.9|20\.0)\d\d, z 10\.000 mm\)$")
        page.click("#measure")
        self.assertEqual(page.run("document.querySelectorAll('#measure-labels li').length"), 0)

    def test_measuring_on_clay(self):
        """Of a ball: from clay to clay, and from clay to the tool."""
        scene = (self.folder / "clay.toml").read_text().replace('hand = "near.csv"', "")
        (self.folder / "ball.toml").write_text(scene)
        run = self.run_scene("ball", command="sculpt")
        page = self.open(run)
        page.wait("document.querySelector('#clay-facts').textContent.includes('samples')")
        numbers = lambda: [float(x) for x in re.findall(r"[\d.]+", page.run("document.querySelector('#measure-answer').textContent"))]
        rests = run.get("state")["tool_cp"]["p"]
        page.click("#measure")
        # The middle of the picture is the middle of ball and tool, 5 mm over that of the ball; the lines of sight there are those of y and x.
        across = (15**2 - 5**2) ** 0.5
        for view in ("front", "side"):
            page.click(f"[data-view={view}]")
            page.click("[data-view=fit]")
            page.wait(DRAWN)
            page.drag(page.middle_of("#view"), page.middle_of("#view"))
            page.wait(DRAWN)
        size, x, y, z = numbers()
        self.assertAlmostEqual(size, 2**0.5 * across, delta=0.2)
        for found, expected in ((x, across), (y, across), (z, 0)):
            self.assertAlmostEqual(found, expected, delta=0.2)
        page.screenshot(SHOTS / "measure-clay.png")
        # The tool hangs with its middle 22 mm over that of the ball.
        page.press("Escape")
        page.drag(page.middle_of("#view"), page.middle_of("#view"))
        at = self.middle_of_tool(page)
        page.drag(at, at)
        page.wait(DRAWN)
        size, x, y, z = numbers()
        for found, expected in ((x, across - 3), (y, 0), (z, 17)):
            self.assertAlmostEqual(found, expected, delta=0.5)
        self.assertLess(max(abs(a - b) for a, b in zip(rests, run.get("state")["tool_cp"]["p"])), 1e-4, "the cursor measures, and does not lead the tool")
        # Cut away it cannot be met: behind the plane there is the far side, which does not face the eye.
        page.press("Escape")
        page.click("#section")
        page.click("#section-box [data-axis='0']")
        page.drag(page.middle_of("#view"), page.middle_of("#view"))
        page.wait("document.querySelector('#measure-answer').textContent === 'There is nothing at that place'")

    def middle_of_tool(self, page):
        """Where the middle of the tool is in the window: handles of the hand go from 28 to 72 pixels from there."""
        return page.run(
            """(() => {
              const { x, y } = document.querySelector('#view').getBoundingClientRect();
              const [ax, bx, ay, by] = ['x1', 'x2', 'y1', 'y2'].map((name) => Number(document.querySelector('#hand-overlay [data-axis=z]').getAttribute(name)));
              return [x + ax - (28 / 44) * (bx - ax), y + ay - (28 / 44) * (by - ay)];
            })()"""
        )

    def test_force_by_component(self):
        """An arm that stands turned in its scene: both wrenches along the axes of world, and the depth over the path of the tool."""
        turned = (self.folder / "press.toml").read_text() + "\n[device.world_from_device]\norientation_xyzw = [0.0, 0.0, 0.7071067811865476, 0.7071067811865476]\n"
        (self.folder / "turned.toml").write_text(turned)
        run = self.run_scene("turned")
        page = self.open(run)
        page.wait(IN_CONTACT)
        page.wait(f"{number('read-force')} > 0.5")
        cells = "(id) => [...document.querySelectorAll(`#${id} td`)].map((cell) => Number(cell.textContent.replace('−', '-')))"
        page.wait(f"Math.abs(({cells})('contact-force')[2]) > 0.5 && Math.abs(({cells})('command-force')[2]) > 0.3")
        contact, command = page.run(f"['contact-force', 'command-force'].map({cells})")
        for x, y, z, size in (contact, command):
            self.assertAlmostEqual((x * x + y * y + z * z) ** 0.5, size, delta=0.02)
            self.assertGreater(z, abs(x) + abs(y), "the plane pushes up")
        # What the state has in the arm's axes stands in those of world: turned by a right angle about z.
        state = {"contact_cf": {"f": [1, 2, 3], "t": [0, 0, 0]}, "servo_cf": {"f": [1, 0, 0], "t": [0, 0.002, 0]}}
        rows = page.run(
            f"""Promise.all([import('/web/wrench.js'), fetch('/api/v1/scene').then((r) => r.json())]).then(([{{ Wrench }}, scene]) => {{
              document.querySelector('#wrench tbody').replaceChildren();
              const wrench = new Wrench({{ direction: [0, 0, -1] }});
              wrench.learn(scene);
              wrench.show({json.dumps(state)});
              const rows = ['command-force', 'command-torque'].map({cells});
              return [...rows, document.querySelector('#insertion-force').textContent];
            }})"""
        )
        self.assertEqual(rows, [[0, 1, 0, 1], [-2, 0, 0, 2], "3.00"])

    def test_depth_over_path(self):
        run = self.run_scene("press")
        page = self.open(run)
        page.wait("parseFloat(document.querySelector('#plot-path output').value) > 12")
        page.wait(IN_CONTACT)
        page.wait(DRAWN)
        self.assertGreater(page.count_pixels("#plot-path canvas", "--point"), 20, "a line")
        page.click("#pause")
        page.wait(DRAWN)
        still = page.picture_of("#plot-path canvas")
        page.wait("new Promise((done) => setTimeout(() => done(true), 400))")
        self.assertEqual(page.picture_of("#plot-path canvas"), still)
        # Steps of a hundredth of a millimetre are no way, those of a millimetre are; the deepest tick of a step counts.
        steps = page.run(
            """import('/web/path.js').then(({ ToolPath }) => {
              const path = new ToolPath();
              const push = (time_ns, x, depth, history = []) => path.push({ time_ns, scene_idx: 1, max_depth_m: depth, tool_cp: { p: [x, 0, 0] }, history });
              push(1, 0, 0);
              push(2, 1e-5, 0, [[0, 0, 0.5, 0, 0]]);
              push(3, 1e-3, 1e-4);
              push(4, 0, 0);
              const before = path.steps.map((step) => Object.values(step));
              push(1, 0, 0);
              return [before, path.steps.length, path.direction];
            })"""
        )
        self.assertEqual(steps, [[[0, 0, 0.5], [1, 0.1, 0.1], [2, 0, 0]], 1, None])

    def downloads(self, page):
        """A folder into which the page's downloads go."""
        folder = self.folder / f"downloads-{page.target}"
        folder.mkdir()
        page.browser.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
        return folder

    def downloaded(self, folder, pattern):
        """The one file whose name ends so, once it is whole."""
        end = time.monotonic() + 60
        while True:
            found = [file for file in folder.glob(pattern) if file.stat().st_size > 0]
            if found and not list(folder.glob("*.crdownload")):
                return found[0]
            self.assertLess(time.monotonic(), end, f"{pattern} in {list(folder.iterdir())}")
            time.sleep(0.1)

    def test_exports(self):
        run = self.run_scene("press")
        page = self.open(run)
        folder = self.downloads(page)
        page.wait(IN_CONTACT)
        page.click("#export-csv")
        head, *rows = self.downloaded(folder, "*-plots.csv").read_text().splitlines()
        self.assertEqual(head, "time_s,force_n,depth_mm,tick_us,wakeup_us")
        numbers = [[float(field) for field in row.split(",")] for row in rows]
        self.assertGreater(len(numbers), 100)
        self.assertTrue(all(a[0] <= b[0] for a, b in zip(numbers, numbers[1:])), "in the order of time")
        self.assertGreater(max(row[2] for row in numbers), 0, "and in contact")
        page.click("#export-path-csv")
        head, *rows = self.downloaded(folder, "*-path.csv").read_text().splitlines()
        self.assertEqual(head, "path_mm,least_depth_mm,largest_depth_mm")
        self.assertGreater(float(rows[-1].split(",")[0]), 1)

        page.click("#export-png")
        png = self.downloaded(folder, "*-view.png").read_bytes()
        self.assertEqual(png[:8], b"\x89PNG\r\n\x1a\n")
        width, height = struct.unpack(">II", png[16:24])
        self.assertEqual([width, height], page.run("(() => { const { width, height } = document.querySelector('#view'); return [width, height]; })()"))
        # What is in the picture is what is seen: the tool has its colour, and more than the ground is there.
        data = base64.b64encode(png).decode()
        blue = page.run(COUNT_PIXELS % (json.dumps(data), json.dumps("--tool")))
        self.assertGreater(blue, 500)
        (SHOTS / "export.png").write_bytes(png)

        page.click("#export-webm")
        page.wait("document.querySelector('#export-webm').textContent === 'End film'")
        page.wait("new Promise((done) => setTimeout(() => done(true), 2500))")
        page.click("#export-webm")
        film = self.downloaded(folder, "*-view.webm")
        self.assertEqual(film.read_bytes()[:4], b"\x1aE\xdf\xa3", "EBML")
        # The page itself plays no films.
        player = self.browser.open("about:blank")
        self.addCleanup(player.close)
        size = player.run(
            f"""(async () => {{
              const bytes = Uint8Array.from(atob({json.dumps(base64.b64encode(film.read_bytes()).decode())}), (c) => c.charCodeAt(0));
              const video = document.createElement('video');
              video.muted = true;
              video.src = URL.createObjectURL(new Blob([bytes], {{ type: 'video/webm' }}));
              await new Promise((done, failed) => {{ video.onloadeddata = done; video.onerror = () => failed(new Error(video.error.message)); }});
              return [video.videoWidth, video.videoHeight];
            }})()"""
        )
        self.assertEqual(size, [width, height])

    def test_recordings_of_the_run(self):
        run = self.run_scene("rest")
        page = self.open(run)
        folder = self.downloads(page)
        self.assertEqual(run.get("recordings"), [])
        page.run("document.querySelector('#record-file').value = 'trial one.mcap'")
        page.click("#record")
        page.wait("document.querySelector('#recordings').textContent.includes('under way')")
        self.assertEqual(self.status(run, "recordings/1"), 409, "no client gets half a file")
        page.click("#record")
        page.wait("document.querySelectorAll('#recordings a').length === 2")
        (made,) = run.get("recordings")
        written = (self.folder / "state" / "hapticd" / "recordings" / "trial one.mcap").read_bytes()
        self.assertEqual((made["number"], made["name"], made["bytes"], made["is_under_way"]), (1, "trial one.mcap", len(written), False))
        self.assertIn(" ticks, ", page.run("document.querySelector('#recordings small').textContent"))
        page.click("#recordings a")
        self.assertEqual(self.downloaded(folder, "trial one.mcap").read_bytes(), written)

        # The report is a page of its own, with its styles.
        report = page.browser.open(f"{run.url}api/v1/recordings/1/report", **SCREENS["desktop-light"])
        self.addCleanup(report.close)
        self.assertIn("trial one.mcap", report.run("document.body.textContent"))
        self.assertGreater(report.run("document.styleSheets[0].cssRules.length"), 5)
        self.assertEqual(report.complaints(), [])
        self.assertEqual(page.run("document.querySelectorAll('#recordings a')[1].href"), f"{run.url}api/v1/recordings/1/report")
        # Names of files lead nowhere.
        for path in ("recordings/2", "recordings/0/report"):
            self.assertEqual(self.status(run, path), 404, path)
        for path in ("recordings/trial%20one.mcap", "recordings/..%2F..%2Fnear.csv", "recordings/1%2F..%2F2"):
            self.assertIn(self.status(run, path), (400, 404), path)

    def test_recordings_with_a_token(self):
        """A link cannot carry it: the page fetches the file."""
        token = "0123456789abcdef0123456789abcdef"
        file = self.folder / "token-of-recordings"
        file.write_text(token)
        run = self.run_scene("rest", "--monitor-token", str(file))
        page = self.open_url(f"{run.url}#token={token}")
        folder = self.downloads(page)
        page.run("document.querySelector('#record-file').value = 'with-token'")
        page.click("#record")
        page.wait("document.querySelector('#record').textContent === 'End'")
        page.click("#record")
        page.wait("document.querySelectorAll('#recordings a').length === 2")
        page.click("#recordings a")
        self.assertEqual(self.downloaded(folder, "with-token.mcap").read_bytes()[:5], b"\x89MCAP")
        # As a user does: a browser asks before it takes several files that no click asked for.
        page.click("#recordings a:nth-of-type(2)")
        self.assertIn("<!doctype html>", self.downloaded(folder, "with-token.html").read_text()[:20].lower())

    def test_files_of_clay(self):
        run = self.run_scene("clay", command="sculpt")
        page = self.open(run)
        folder = self.downloads(page)
        page.wait("document.querySelector('#clay-facts').textContent.includes('samples')")
        page.run("document.querySelector('#clay-file').value = 'ball'")
        page.click("#clay-save button[value=points]")
        page.wait("document.querySelectorAll('#clay-files a').length === 1")
        written = (self.folder / "state" / "hapticd" / "clay" / "ball.ply").read_bytes()
        page.click("#clay-files a")
        self.assertEqual(self.downloaded(folder, "ball.ply").read_bytes(), written)
        self.assertEqual(self.status(run, "clay/files/2"), 404)
        self.assertEqual(self.status(run, "clay/files/0"), 404)

    def status(self, run, path):
        try:
            with urllib.request.urlopen(f"{run.url}api/v1/{path}", timeout=10) as answer:
                return answer.status
        except urllib.error.HTTPError as refused:
            return refused.code

    def test_numbers_as_people_write_them(self):
        run = self.run_scene("rest")
        page = self.open(run)
        name = "contact_stiffness_n_per_m"
        answer = f"document.querySelector('#answer-{name}').textContent"
        value = lambda: next(p["value"] for p in run.get("parameters") if p["name"] == name)
        self.write(page, f"#field-{name}", "4,5")
        page.wait(f"{answer}.startsWith('set')")
        self.assertAlmostEqual(value(), 4500, places=6)
        page.wait("document.querySelector('#events').textContent.includes('Contact stiffness goes to 4.5 N/mm')")
        # Beyond its range it stays where it is, and the range is named in the unit of the field.
        self.write(page, f"#field-{name}", "1e9")
        self.assertRegex(page.run(answer), r"^1e9 is out of range: [\d.]+ to [\d.]+ N/mm$")
        self.assertEqual(page.run(f"document.querySelector('#field-{name}').value"), "4.5")
        self.write(page, f"#field-{name}", "1.204,5")
        self.assertIn("is no number", page.run(answer))
        self.assertAlmostEqual(value(), 4500, places=6)

        height = "#object-lift label:nth-of-type(3) input"
        self.write(page, height, "−4,25")
        page.wait("document.querySelector('#object-lift .answer').textContent === 'stands at 0.00, 0.00, −4.25 mm'")
        self.write(page, height, "low")
        self.assertIn("“low” is no number", page.run("document.querySelector('#object-lift .answer').textContent"))
        self.assertEqual(
            page.run("import('/web/number-field.js').then(({ readNumber }) => ['1,5', ' 1.5 ', '−3', '2e-3', '.5', '', '1 5', '1.2.3', '0x10', 'NaN'].map((text) => String(readNumber(text))))"),
            ["1.5", "1.5", "-3", "0.002", "0.5", "NaN", "NaN", "NaN", "NaN", "NaN"],
        )

    def test_more_contacts_than_are_shown(self):
        fine = (self.folder / "press.toml").read_text().replace("voxel_size_mm = 1.5", "voxel_size_mm = 0.5")
        (self.folder / "fine.toml").write_text(fine)
        run = self.run_scene("fine")
        page = self.open(run)
        legend = "document.querySelector('#legend-contacts').textContent"
        page.wait("Number(document.querySelector('#read-contacts').textContent) > 1000")
        page.wait(f"{legend}.endsWith(' points shown')")
        shown, all = page.run(f"{legend}.match(/^([\\d\u202f]+) of ([\\d\u202f]+) /).slice(1).map((n) => Number(n.replace('\u202f', '')))")
        self.assertTrue(256 <= shown <= 512 < 1000 < all, (shown, all))

    def test_first_view_has_everything(self):
        """The path of the hand too; and another part does not take the view that the user chose."""
        (self.folder / "far.csv").write_text("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.025,0,0,0,1\n200,0.05,0,0.125,0,0,0,1\n")
        (self.folder / "far.toml").write_text(BLOCK.replace("above.csv", "far.csv"))
        run = self.run_scene("far")
        page = self.open(run)
        scene = run.get("scene")
        for found, expected in zip(scene["hand_bounds"]["min"] + scene["hand_bounds"]["max"], [-0.005, -0.005, 0.015, 0.055, 0.005, 0.135]):
            self.assertAlmostEqual(found, expected, places=6)
        self.assertAlmostEqual(scene["bounds"]["max"][2], 0.035, places=3)
        corners = page.run(
            """(async () => {
              const [{ OrbitCamera }, { project }, { cornersOf }] = await Promise.all(['camera', 'pick', 'math'].map((name) => import(`/web/${name}.js`)));
              const view = document.querySelector('#view');
              const canvas = document.createElement('canvas');
              Object.defineProperties(canvas, { clientWidth: { value: view.clientWidth }, clientHeight: { value: view.clientHeight } });
              const camera = new OrbitCamera(canvas, () => {});
              const [min, max] = [[-0.03, -0.02, -0.01], [0.055, 0.02, 0.135]];
              camera.subject = { min, max, middle: [0.0125, 0, 0.0625], radius: Math.hypot(0.085, 0.04, 0.145) / 2 };
              camera.fit();
              window.expected = camera;
              return cornersOf({ min, max }).map((corner) => project({ canvas, camera }, corner)).every(([x, y]) => x > 0 && y > 0 && x < view.clientWidth && y < view.clientHeight);
            })()"""
        )
        self.assertTrue(corners)
        page.screenshot(SHOTS / "first-view.png")
        kept = page.run(
            """import('/web/scene.js').then(({ SceneView }) => {
              const canvas = document.createElement('canvas');
              document.body.append(canvas);
              Object.assign(canvas.style, { width: '300px', height: '200px' });
              const view = new SceneView(canvas, () => {});
              const part = (idx, size) => ({ idx, role: 'static', pose: { p: [0, 0, 0], q: [0, 0, 0, 1] }, mesh: {
                positions: new Float32Array(9), normals: new Int8Array(12), edges: new Float32Array(0), min: [-size, -size, -size], max: [size, size, size] } });
              view.alsoSeen = { min: [0, 0, 0], max: [0, 0, 1] };
              view.add(part(0, 0.1));
              view.fitUntouched();
              const first = view.camera.distance;
              const { max } = view.camera.subject;
              view.add(part(1, 2));
              view.fitUntouched();
              const grown = view.camera.distance;
              // Pressed in the view: from now on nothing moves it, until it is fitted again.
              canvas.dispatchEvent(new KeyboardEvent('keydown', { key: 'z' }));
              view.add(part(3, 3));
              view.fitUntouched();
              const used = view.camera.distance === grown;
              view.fit();
              const fitted = view.camera.distance > grown;
              view.camera.zoom(0.5);
              const chosen = view.camera.distance;
              view.add(part(2, 4));
              view.fitUntouched();
              canvas.remove();
              return { max, grew: grown > 1.5 * first, used, fitted, kept: view.camera.distance === chosen, box: view.box.max };
            })"""
        )
        self.assertEqual(kept, {"max": [0.1, 0.1, 1], "grew": True, "used": True, "fitted": True, "kept": True, "box": [4, 4, 4]})

    def test_what_is_sent_is_compressed(self):
        run = self.run_scene("block")
        page = self.open(run)
        sizes = page.run("performance.getEntriesByType('resource').map(({ name, encodedBodySize, decodedBodySize }) => [name, encodedBodySize, decodedBodySize])")
        scripts = [(encoded, decoded) for name, encoded, decoded in sizes if "/web/" in name]
        self.assertGreater(len(scripts), 20)
        encoded, decoded = map(sum, zip(*scripts))
        print(f"the page: {decoded} bytes, {encoded} sent")
        self.assertLess(encoded, 0.5 * decoded)
        # What asks for nothing gets it as it is.
        with urllib.request.urlopen(f"{run.url}web/main.js", timeout=10) as plain:
            self.assertIsNone(plain.headers["Content-Encoding"])
            self.assertTrue(plain.read().startswith(b"/**"))

    def test_clearance_in_colours(self):
        """Of a box over a plate: the lower face has the distance between them, what is out of reach the most that is known."""
        (self.folder / "near-block.csv").write_text("t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.022,0,0,0,1\n")
        near = BLOCK.replace("above.csv", "near-block.csv").replace("[0.0, 0.0, 25.0]", "[0.0, 0.0, 22.0]").replace("voxel_size_mm = 1.0\n\n[tool]", "voxel_size_mm = 1.0\nlayers = 6\n\n[tool]")
        (self.folder / "near-block.toml").write_text(near)
        run = self.run_scene("near-block")
        page = self.open(run)
        points = page.run(
            """fetch('/api/v1/clearance').then((r) => r.arrayBuffer()).then((buffer) => {
              const data = new DataView(buffer);
              const n = data.getUint32(8, true);
              const point = (k) => [0, 4, 8, 16].map((at) => data.getFloat32(32 + 20 * k + at, true)).concat([12, 13, 14].map((at) => data.getInt8(32 + 20 * k + at)));
              return { known: data.getFloat32(16, true), points: Array.from({ length: n }, (_, k) => point(k)) };
            })"""
        )
        known = points["known"]
        self.assertAlmostEqual(known, 5.5e-3, places=5)
        self.assertGreater(len(points["points"]), 500)
        for x, y, z, clearance, nx, ny, nz in points["points"]:
            # The lowest point of the tool stands 2 mm over the block, whose distances are known to a fraction of a voxel.
            self.assertAlmostEqual(clearance, min(known, z + 0.012), delta=0.6e-3)
        lowest = [point for point in points["points"] if point[2] < -0.0099 and abs(point[0]) < 0.004 and abs(point[1]) < 0.004]
        self.assertGreater(len(lowest), 20)
        self.assertTrue(all(point[6] < -120 for point in lowest), "normals point out of the tool")
        page.click("#clearance")
        page.wait("document.querySelector('#legend-clearance').textContent === 'clearance, 0 to 5.5 mm and more'")
        page.wait(DRAWN)
        page.screenshot(SHOTS / "clearance.png")
        # 2 of 5.5 mm: orange, on the lower edge that is seen.
        self.assertGreater(page.count_pixels("#view", "#e6972a"), 20)
        page.click("#clearance")
        page.wait(DRAWN)
        self.assertEqual(page.count_pixels("#view", "#e6972a"), 0)

    def test_parts_as_voxels_and_points(self):
        """The structures of the method, in place of the parts: as many voxels as 61 × 41 × 21 of 1 mm have on their outside, and 11 × 11 × 21 of the tool."""
        page = self.open(self.run_scene("block"))
        choose = lambda word: page.run(f"((choice) => {{ choice.value = '{word}'; choice.dispatchEvent(new Event('change')); }})(document.querySelector('#structure'))")
        told = "document.querySelector('#legend-structure').textContent.replaceAll('\u202f', '')"
        self.assertEqual(page.count_pixels("#view", "#cda060"), 0)
        choose("voxels")
        n = 61 * 41 * 21 - 59 * 39 * 19 + 11 * 11 * 21 - 9 * 9 * 19
        page.wait(f"{told} === '{n} surface voxels of 1 mm'")
        page.wait(DRAWN)
        page.screenshot(SHOTS / "voxels.png")
        voxels = page.count_pixels("#view", "#cda060")
        self.assertGreater(voxels, 2000)
        choose("points")
        page.wait(f"/^\\d+ points, voxels of 1 mm$/.test({told})")
        page.wait(DRAWN)
        page.screenshot(SHOTS / "points.png")
        points = page.count_pixels("#view", "#cda060")
        self.assertTrue(200 < points < voxels, f"{points} of {voxels}")
        # A context that is lost and restored takes all that was on the graphics card along.
        page.run("(window.card = document.querySelector('#view').getContext('webgl2').getExtension('WEBGL_lose_context')).loseContext()")
        page.run("new Promise((done) => setTimeout(() => { window.card.restoreContext(); done(true); }, 200))")
        page.wait(f"/^\\d+ points, voxels of 1 mm$/.test({told})")
        page.wait(DRAWN)
        page.pixels_above(200, "#view", "#cda060")
        # The parts of another scene come as was chosen, also when that was before they came.
        (self.folder / "other.toml").write_text(BLOCK.replace("60.0, 40.0, 20.0", "30.0, 30.0, 20.0").replace("block scene", "other scene"))
        page.run("fetch('/api/v1/scene', { method: 'POST', body: JSON.stringify({ scene: 'other' }) }).then((r) => r.status)")
        page.wait("document.title.startsWith('other scene')")
        choose("voxels")
        n = 31 * 31 * 21 - 29 * 29 * 19 + 11 * 11 * 21 - 9 * 9 * 19
        page.wait(f"{told} === '{n} surface voxels of 1 mm'")
        choose("surfaces")
        page.wait(DRAWN)
        self.assertEqual(page.count_pixels("#view", "#cda060"), 0)
        self.assertTrue(page.run("document.querySelector('#legend-structure').hidden"))

    def test_every_screen(self):
        page = self.open(self.run_scene("press"))
        page.click("#section")
        page.click("#measure")
        for name, screen in SCREENS.items():
            with self.subTest(name):
                page.on_screen(**screen)
                page.run("document.querySelector('main').scrollTo(0, 0), scrollTo(0, 0)")
                page.wait(IN_CONTACT)
                page.wait(DRAWN)
                page.screenshot(SHOTS / f"view-{name}.png")
                self.assertLessEqual(page.run("document.documentElement.scrollWidth"), screen["width"], "nothing is cut off at the side")
                self.assertEqual(page.unnamed_controls(), [], "every control has a name")
                self.assertEqual(page.poor_contrasts(), [], "text can be read")
                if screen.get("touch"):
                    self.assertEqual(page.small_targets(44), [], "a finger meets every control")
                page.run("document.querySelector('#wrench').scrollIntoView({ block: 'start' })")
                page.wait(DRAWN)
                page.screenshot(SHOTS / f"view-{name}-panel.png")
                page.run("document.querySelector('#export-csv').scrollIntoView({ block: 'end' })")
                page.wait(DRAWN)
                page.screenshot(SHOTS / f"view-{name}-save.png")


if __name__ == "__main__":
    unittest.main(verbosity=2)
