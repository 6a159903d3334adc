"""The monitor page in a real browser, against real runs on the simulated arm. Started by scripts/browser-test."""

import functools
import http.server
import pathlib
import tempfile
import threading
import time
import unittest

from hapticd import REPOSITORY
from page_case import DRAWN, IN_CONTACT, SCREENS, SHOTS, VIEW_IS_READY, WORD, PageCase, number

CLAY_SCREENS = SCREENS | {
    "tablet-dark": {"width": 820, "height": 1180, "touch": True, "dark": True},
    "phone-dark": {"width": 390, "height": 844, "touch": True, "dark": True},
    "phone-small": {"width": 360, "height": 640, "touch": True},
    "phone-on-its-side": {"width": 844, "height": 390, "touch": True},
}

SMALL = {"width": 1100, "height": 700}

LONGEST_STANDSTILL_MS = """new Promise((done) => {
    let [last, longest] = [performance.now(), 0];
    const watch = setInterval(() => {
        const now = performance.now();
        [last, longest] = [now, Math.max(longest, now - last)];
    }, 20);
    setTimeout(() => { clearInterval(watch); done(longest); }, 800);
})"""


IS_FREE = "fetch('/api/v1/clay').then((r) => r.json()).then(({ is_held }) => !is_held)"

# Rounded corners of the buttons over a picture are blended anew for each, and not always to the last bit of 255.
ROUNDING = 2


class PageTest(PageCase):
    def test_no_arrow_without_contact(self):
        self.assertEqual(self.open(self.run_scene("rest")).count_pixels("#view", "--force"), 0)

    def test_moves_and_shows_the_force(self):
        run = self.run_scene("press")
        page = self.open(run)
        self.assertEqual(page.run("document.querySelector('#scene-name').textContent"), "press scene")
        page.wait(IN_CONTACT)
        before = page.picture_of("#view")
        page.wait(f"{number('read-force')} > 0.5")
        page.wait(f"{number('read-depth')} > 0")
        page.wait(f"{number('read-speed')} > 1")
        # The hand comes and goes, so a picture may be of another force than the one that was read.
        page.pixels_above(50, "#view", "--force")
        self.assertNotEqual(page.picture_of("#view"), before, "the tool moves")
        for plot, color in (("plot-force", "--force"), ("plot-depth", "--point"), ("plot-compute", "--series-a"), ("plot-wakeup", "--series-b")):
            self.assertGreater(page.count_pixels(f"#{plot} canvas", color), 20, f"a line in {plot}")
            self.assertRegex(page.run(f"document.querySelector('#{plot} output').value"), r"^−?\d")
        before = page.picture_of("#plot-force canvas")
        page.wait(f"{number('read-speed')} > 1")
        self.assertNotEqual(page.picture_that_is_not(before, "#plot-force canvas"), before, "plots run")

        # What was asked for before the click is drawn still.
        page.click("#pause")
        still = page.picture_at_rest("#plot-force canvas")
        page.wait("new Promise((done) => setTimeout(() => done(true), 300))")
        self.assertEqual(page.picture_of("#plot-force canvas"), still, "paused plots stand still")

    def test_disable_and_enable(self):
        run = self.run_scene("press")
        page = self.open(run)
        page.wait(f"{number('read-force')} > 0.5")
        page.click("#disable")
        page.wait(f"{WORD} === 'Disabled'")
        page.wait(f"{number('read-force')} === 0")
        self.assertEqual(run.get("state")["servo_cf"]["f"], [0, 0, 0])
        self.assertIn("no force", page.run("document.querySelector('#state-note').textContent"))

        page.click("#enable")
        page.wait(f"{WORD} === 'Enabled'")
        self.assertEqual(run.get("state")["state"], "ENABLED")

        # From wherever the focus is, also from a field.
        page.run("document.querySelector('#parameters input[type=text]').focus()")
        page.press("Escape")
        page.wait(f"{WORD} === 'Disabled'")

    def test_keyboard_alone(self):
        run = self.run_scene("rest")
        page = self.open(run)
        page.press("Escape")
        # The phase is told before the drive has followed, and until then the button is out of the order of the tab key.
        page.wait(f"{WORD} === 'Disabled' && !document.querySelector('#enable').disabled")
        for _ in range(3):
            page.press("Tab")
            if page.run("document.activeElement.id") == "enable":
                break
        self.assertEqual(page.run("document.activeElement.id"), "enable", "among the first stops of the tab key")
        self.assertNotEqual(page.run("getComputedStyle(document.activeElement).outlineStyle"), "none", "the focus can be seen")
        page.press("Enter")
        page.wait(f"{WORD} === 'Enabled'")

        page.run("document.querySelector('#view').focus()")
        before = page.picture_of("#view")
        page.press("ArrowLeft")
        page.wait(DRAWN)
        self.assertNotEqual(page.picture_of("#view"), before, "arrow keys turn the view")

    def test_parameters(self):
        run = self.run_scene("press")
        page = self.open(run)
        page.wait(IN_CONTACT)

        def served(name):
            return next(p for p in run.get("parameters") if p["name"] == name)

        depth = run.get("state")["max_depth_m"] * 1e3
        name = "contact_stiffness_n_per_m"
        scene = served(name)["scene"]
        page.run(f"document.querySelector('#slider-{name}').focus()")
        page.press("Home")
        page.wait(f"document.querySelector('#answer-{name}').textContent.startsWith('set')")
        self.assertAlmostEqual(served(name)["value"], served(name)["least"], places=6)
        page.wait(f"{number('read-depth')} > {1.5 * depth}")

        page.click(f"#parameter-{name} .reset")
        page.wait(f"document.querySelector('#parameter-{name} .reset').disabled")
        self.assertEqual(served(name)["value"], scene)

        # A field takes the units of the scene file.
        page.run(f"(() => {{ const f = document.querySelector('#field-{name}'); f.value = '3'; f.dispatchEvent(new Event('change')); }})()")
        page.wait(f"document.querySelector('#answer-{name}').textContent.startsWith('set')")
        self.assertAlmostEqual(served(name)["value"], 3000, places=6)

        # What the user is writing stays, whatever other clients set meanwhile.
        page.run(f"(() => {{ const f = document.querySelector('#field-{name}'); f.focus(); f.value = '4'; f.dispatchEvent(new Event('input')); }})()")
        run.send("PUT", f"parameters/{name}", {"value": 3500})
        page.wait(f"document.querySelector('#slider-{name}').getAttribute('aria-valuetext').startsWith('3.5')")
        self.assertEqual(page.run(f"document.querySelector('#field-{name}').value"), "4")
        page.run("document.activeElement.blur()")
        self.assertEqual(page.run(f"document.querySelector('#field-{name}').value"), "3.5")

        # Two that do not go together: what the loop makes of it.
        page.run("(() => { const f = document.querySelector('#field-filter_cutoff_low_hz'); f.value = '400'; f.dispatchEvent(new Event('change')); })()")
        page.wait("document.querySelector('#answer-filter_cutoff_high_hz').textContent === 'acts as 400: never below the low cut-off'")

    def test_movable_part(self):
        run = self.run_scene("rest")
        page = self.open(run)
        before = page.picture_of("#view")
        height = "document.querySelectorAll('#object-lift input')[2]"
        answer = "document.querySelector('#object-lift .answer').textContent"
        page.run(f"(() => {{ const f = {height}; f.value = '-4'; f.dispatchEvent(new Event('change')); }})()")
        page.wait(f"{answer} === 'stands at 0.00, 0.00, −4.00 mm'")
        self.assertNotEqual(page.picture_of("#view"), before, "the part moved")

        # The fields say where it stands, whichever client moved it.
        run.send("PUT", "objects/lift/pose", {"p": [0, 0, -0.006], "q": [0, 0, 0, 1]})
        page.wait(f"{height}.value === '-6'")
        # The field is rounded: the part may still be on its way.
        page.wait("fetch('/api/v1/state').then((r) => r.json()).then(({ objects }) => Math.abs(objects[0].p[2] + 0.006) < 1e-7)")

        # A slip of the finger is asked about.
        page.run(f"(() => {{ const f = {height}; f.value = '-5000'; f.dispatchEvent(new Event('change')); }})()")
        self.assertIn("far outside", page.run(answer))
        self.assertAlmostEqual(run.get("state")["objects"][0]["p"][2], -0.006, places=6)
        page.click("#object-lift button")
        page.wait(f"{answer}.includes('on its way to 0.00, 0.00, −5000.00 mm')")

    def test_another_scene(self):
        run = self.run_scene("rest")
        page = self.open(run)
        page.run("document.querySelector('#scene-choice').value = 'press'")
        page.click("#scene-form button")
        page.wait("document.querySelector('#scene-name').textContent === 'press scene'")
        page.wait(VIEW_IS_READY)
        page.wait(f"{WORD} === 'Enabled'")

    def test_what_parts_were_taken_for(self):
        """The panel follows the scene; a part that is as it should be has one line."""
        rest = (self.folder / "rest.toml").read_text()
        mesh = REPOSITORY / "docs" / "pictures" / "solid-pieces.obj"
        pieces = rest.replace("shape = { plane_mm = [60.0, 60.0] }", f'mesh = "{mesh}"\nunits = "mm"\nposition_mm = [0.0, 0.0, -30.0]').replace('"lift"', '"<i>pieces"')
        (self.folder / "pieces.toml").write_text(pieces)
        run = self.run_scene("rest")
        page = self.open(run, **SMALL)
        lines = "[...document.querySelectorAll('#parts > li')].map((part) => [...part.children].map((line) => line.textContent))"
        tool = ["tool", "1 body of 8\u202f000 mm³, 12 triangles, voxels of 1.5 mm"]
        self.assertEqual(page.run(lines), [["lift", "1 body of 68\u202f400 mm³, 12 triangles, voxels of 0.5 mm"], tool])
        page.run("document.querySelector('#scene-choice').value = 'pieces'")
        page.click("#scene-form button")
        page.wait("document.querySelector('#parts strong').textContent === '<i>pieces'")
        found = [
            "<i>pieces",
            "4 pieces, 1 not closed: 2 bodies, 1 hollow of 1\u202f000 mm³ (empty), 1 skin of 400 mm²",
            "the skin is felt as a plate of two voxels",
            "448 mm² inside were left out",
            "volume 11\u202f896 mm³, 38 triangles, voxels of 0.5 mm",
            "4 edges are open, the widest hole is 20.0 mm wide",
        ]
        self.assertEqual(page.run(lines), [found, tool])
        self.assertEqual(page.run("document.querySelector('#parts-verdict').textContent"), "1 warning")
        for name, screen in {"parts": SMALL, "parts-phone": SCREENS["phone"]}.items():
            page.on_screen(**screen)
            page.wait(DRAWN)
            page.run("document.querySelector('#parts-box').scrollIntoView({ block: 'center' })")
            page.screenshot(SHOTS / f"{name}.png")
            self.assertLessEqual(page.run("document.documentElement.scrollWidth"), screen["width"], "nothing is cut off at the side")
            self.assertEqual(page.poor_contrasts(), [], "text can be read")

    def test_fault(self):
        run = self.run_scene("fault")
        page = self.open(run)
        page.wait("!document.querySelector('#banner').hidden")
        self.assertEqual(page.run(WORD), "Fault")
        self.assertIn("not a number", page.run("document.querySelector('#banner').textContent"))
        page.wait(f"{number('read-force')} === 0")
        self.assertRegex(page.run("document.querySelector('#banner-title').textContent"), r"^Fault 6\.\d\d s after the start")
        page.screenshot(SHOTS / "fault.png")
        # The page says that it was there, whichever client acknowledged it.
        run.send("POST", "disable")
        page.wait(f"{WORD} === 'Disabled'")
        self.assertFalse(page.run("document.querySelector('#banner').hidden"))
        page.wait("fetch('/api/v1/state').then((answer) => answer.json()).then(({ time_ns }) => time_ns > 6.8e9)")
        page.click("#banner-enable")
        page.wait(f"{WORD} === 'Enabled'")
        self.assertTrue(page.run("document.querySelector('#banner').hidden"))

    def test_connection_lost_and_found(self):
        run = self.run_scene("rest")
        page = self.open(run, complains=True)
        run.kill()
        page.wait("!document.querySelector('#lost').hidden")
        page.wait("document.querySelector('#lost').textContent.includes('Connection lost')")
        self.assertTrue(page.run("document.body.classList.contains('is-stale')"))
        self.assertEqual(page.run(WORD), "Unknown")
        page.screenshot(SHOTS / "lost.png")
        self.run_scene("press", address=run.url.removeprefix("http://").rstrip("/"))
        page.wait("document.querySelector('#lost').hidden")
        page.wait("document.querySelector('#scene-name').textContent === 'press scene'")
        page.wait(f"{WORD} === 'Enabled'")

    def test_guard(self):
        run = self.run_scene("rest")
        page = self.browser.open(run.url, **SCREENS["desktop-light"])
        page.wait(VIEW_IS_READY)
        page.wait(f"{WORD} === 'Enabled'")
        other = self.open(run)
        page.run("document.querySelector('#guard').focus()")
        page.press(" ")
        # Only what the server has heard of can fall silent.
        on_guard = "document.querySelector('#guard-answer').textContent === 'on guard'"
        page.wait(on_guard)
        # Silent once, longer than it may be, and on guard again.
        page.run("(() => { const until = performance.now() + 4000; while (performance.now() < until); })()")
        other.wait(f"{WORD} === 'Disabled'")
        page.wait(f"{WORD} === 'Disabled'")
        page.wait(on_guard)
        other.click("#enable")
        other.wait(f"{WORD} === 'Enabled'")
        page.wait(f"{WORD} === 'Enabled'")
        page.close()
        other.wait(f"{WORD} === 'Disabled'")
        other.wait("document.querySelector('#events').textContent.includes('force off')")
        self.assertRegex(other.run("document.querySelector('#events time').textContent"), r"^(?!0\.00)\d+\.\d\d s$")

    def test_token(self):
        file = self.folder / "token"
        file.write_text("0123456789abcdef0123456789abcdef")
        run = self.run_scene("rest", "--monitor-token", str(file))
        page = self.browser.open(run.url)
        self.addCleanup(page.close)
        page.wait("!document.querySelector('#token-form').hidden")
        page.run("document.querySelector('#token').value = 'another token of its length......'")
        page.click("#token-form button")
        page.wait("document.querySelector('#token-label').textContent.startsWith('Wrong token')")
        page.run(f"document.querySelector('#token').value = '{file.read_text()}'")
        page.click("#token-form button")
        page.wait(f"{WORD} === 'Enabled'")
        self.assertTrue(page.run("document.querySelector('#token-form').hidden"))

        linked = self.open_url(f"{run.url}#token={file.read_text()}")
        self.assertNotIn("token", linked.run("location.href"))

    def test_recording(self):
        run = self.run_scene("rest")
        page = self.open(run)
        page.run("document.querySelector('#record-file').value = 'from-the-page.mcap'")
        page.click("#record")
        page.wait(r"/from-the-page.mcap: [\d\u202f]+ ticks/.test(document.querySelector('#record-facts').textContent)")
        self.assertEqual(page.run("document.querySelector('#record').textContent"), "End")
        page.click("#record")
        page.wait(r"/^[1-9]\d* ticks are recorded in .*\/from-the-page.mcap$/.test(document.querySelector('#record-facts').textContent)")
        file = self.folder / "state" / "hapticd" / "recordings" / "from-the-page.mcap"
        self.assertEqual(file.read_bytes()[:5], b"\x89MCAP")

        # What the server refuses is said in its words.
        page.run("document.querySelector('#record-file').value = 'from-the-page.mcap'")
        page.click("#record")
        page.wait("document.querySelector('#toasts').textContent.includes('exists already')")

    def test_stop(self):
        run = self.run_scene("press")
        page = self.open(run, complains=True)
        page.wait(f"{number('read-force')} > 0.5")
        # Also where drawing takes all that the machine has.
        page.call("Emulation.setCPUThrottlingRate", rate=10)
        page.click("#stop")
        self.assertEqual(run.process.wait(timeout=30), 0)
        page.call("Emulation.setCPUThrottlingRate", rate=1)
        page.wait("document.querySelector('#lost').textContent.includes('The run is over')")
        self.assertEqual(page.run(WORD), "Stopped")

    def test_every_screen(self):
        page = self.open(self.run_scene("press"))
        for name, screen in SCREENS.items():
            with self.subTest(name):
                page.on_screen(**screen)
                page.wait(IN_CONTACT)
                page.wait(f"{number('read-speed')} > 8")
                page.screenshot(SHOTS / f"{name}.png")
                self.assertLessEqual(page.run("document.documentElement.scrollWidth"), screen["width"], "nothing is cut off at the side")
                self.assertEqual(page.unnamed_controls(), [], "every control has a name")
                self.assertEqual(page.poor_contrasts(), [], "text can be read")
                if screen.get("touch"):
                    self.assertEqual(page.small_targets(44), [], "a finger meets every control")

    def sculpt(self, options=(), complains=False, **screen):
        """A run on clay and its page, once samples are drawn."""
        run = self.run_scene("clay", *options, command="sculpt")
        page = self.open(run, complains, **screen)
        page.wait("document.querySelector('#clay-facts').textContent.includes('samples')")
        return run, page

    def choose(self, run, page, craft):
        page.click(f"#clay-crafts button[value={craft}]")
        page.wait(f"document.querySelector('#clay-crafts button[value={craft}]').getAttribute('aria-pressed') === 'true'")
        self.assertEqual(run.get("clay")["craft"], craft)

    def test_clay_is_drawn(self):
        run, page = self.sculpt()
        drawn = "import('/web/splats.js').then(({ parseSamples }) => fetch('/api/v1/clay/points').then((r) => r.arrayBuffer()).then((b) => { const s = parseSamples(b); return [s.n, s.nAll, s.bytes.length]; }))"
        n, n_all, n_bytes = page.run(drawn)
        self.assertEqual((n, n_bytes), (n_all, 20 * n_all))
        self.assertEqual(n_all, run.get("clay")["samples"])
        facts = page.run("document.querySelector('#clay-facts').textContent")
        self.assertRegex(facts, r" samples; \d[\d\u202f]* updates of the material, the last took [\d.]+ ms")
        self.assertEqual(page.run("document.querySelector('#clay-box').hidden"), False)
        # Clay has a colour of its own, which no part has: all of the ball is covered.
        page.click("#clay-crafts button[value=touch]")
        bare = page.picture_of("#view")
        page.run("document.querySelector('#see-through').click()")
        page.wait(DRAWN)
        self.assertNotEqual(page.picture_of("#view"), bare, "clay lets the tool shine through")

    def test_clay_is_painted(self):
        """The hand touches it once in two seconds: what it touches has the colour of the scene."""
        run, page = self.sculpt()
        blue = "#2060e0"
        self.assertEqual(page.count_pixels("#view", blue), 0, "nothing is blue before")
        self.choose(run, page, "paint")
        self.assertEqual(page.run("document.querySelector('#clay-color').value"), blue)
        page.wait("!document.querySelector('#clay-undo').disabled")
        end = time.monotonic() + 30
        while page.count_pixels("#view", blue) < 50:
            self.assertLess(time.monotonic(), end, "paint can be seen")
        page.run("(() => { const c = document.querySelector('#clay-color'); c.value = '#10a040'; c.dispatchEvent(new Event('change')); })()")
        page.wait("fetch('/api/v1/clay').then((r) => r.json()).then(({ color }) => color === '#10a040')")

    def test_material_is_painted(self):
        """Three numbers, which only the tool for material shows, and what comes of those that are left empty."""
        run, page = self.sculpt()
        line = "document.querySelector('#clay-material-line')"
        self.choose(run, page, "paint")
        self.assertTrue(page.run(f"{line}.hidden"))
        self.choose(run, page, "material")
        self.assertFalse(page.run(f"{line}.hidden"))
        hints = f"[...{line}.querySelectorAll('input')].map(({{ value, placeholder }}) => value || placeholder).join()"
        page.wait(f"{hints} === '500,5,as it is'")
        page.screenshot(SHOTS / "clay-material.png")

        def write(name, value):
            field = f"document.querySelector('#clay-{name}')"
            page.run(f"(() => {{ {field}.value = '{value}'; {field}.dispatchEvent(new Event('change')); }})()")

        write("stiffness-n-per-m", "320")
        page.wait(f"{hints} === '320,as it is,as it is'")
        self.assertEqual(run.get("clay")["painted"], {"mass_kg": None, "damping_n_s_per_m": None, "stiffness_n_per_m": 320})
        # What no mass point can have does not come as far as the server, or is refused there.
        write("mass-kg", "7")
        write("stiffness-n-per-m", "0")
        page.wait(f"{hints}.startsWith('320,as it is')")
        self.assertEqual(run.get("clay")["painted"]["stiffness_n_per_m"], 320)
        page.wait("!document.querySelector('#clay-undo').disabled")

    def test_clay_is_held_and_undone(self):
        run, page = self.sculpt()
        self.choose(run, page, "touch")
        self.assertTrue(page.run("document.querySelector('#clay-hold').matches(':disabled')"), "there is nothing to hold")
        self.choose(run, page, "emboss")
        before = run.get("clay")
        self.hold_by_key(run, page)
        page.hold_key(" ", False)
        page.wait("document.querySelector('#clay-undo').textContent === 'Undo (1)'")
        after = run.get("clay")
        self.assertFalse(after["is_held"])
        self.assertNotEqual(after["version"], before["version"])
        page.undo_key()
        page.wait("document.querySelector('#clay-redo').textContent === 'Redo (1)'")
        self.assertEqual(run.get("clay")["samples"], before["samples"])
        page.undo_key(shift=True)
        page.wait("document.querySelector('#clay-undo').textContent === 'Undo (1)'")
        page.click("#clay-undo")
        page.wait("document.querySelector('#clay-undo').disabled")

        # Force off lets go, and so does a page that hangs; neither holds again by itself.
        for silence in (lambda: page.press("Escape"), lambda: page.run("(() => { const until = performance.now() + 2500; while (performance.now() < until); })()")):
            self.choose(run, page, "pull")
            self.hold_by_key(run, page)
            silence()
            page.wait("document.querySelector('#clay-hold').getAttribute('aria-pressed') === 'false'")
            # The page says so at once, and the server when it has heard of it.
            page.wait(IS_FREE)
            page.hold_key(" ", False)
            if page.run(WORD) != "Enabled":
                page.click("#enable")
                page.wait(f"{WORD} === 'Enabled'")

        # Gone in the middle of it.
        gone = self.browser.open(run.url)
        gone.wait("!document.querySelector('#clay-hold').disabled && document.querySelector('#clay-facts').textContent !== ''")
        self.hold_by_key(run, gone)
        gone.close()
        page.wait(IS_FREE)

    def test_clay_is_saved(self):
        run, page = self.sculpt()
        folder = self.folder / "state" / "hapticd" / "clay"
        # Files of its own, however often it is played in this folder.
        played = time.monotonic_ns()
        for kind, ending, begins in (("points", "ply", b"ply"), ("session", "session", b""), ("export", "ply", b"ply")):
            name = f"ball-{played}-{kind}"
            page.run(f"document.querySelector('#clay-file').value = '{name}'")
            page.click(f"#clay-save button[value={kind}]")
            page.wait(f"document.querySelector('#clay-saved').textContent.includes('{name}.{ending}')")
            self.assertTrue((folder / f"{name}.{ending}").read_bytes().startswith(begins))
        page.click("#clay-save button[value=export]")
        page.wait("document.querySelector('#toasts').textContent.includes('exists already')")

    def test_clay_on_every_screen(self):
        _, page = self.sculpt()
        for name, screen in CLAY_SCREENS.items():
            with self.subTest(name):
                page.on_screen(**screen)
                for craft in ("emboss", "paint"):
                    page.click(f"#clay-crafts button[value={craft}]")
                    page.wait(f"document.querySelector('#clay-crafts button[value={craft}]').getAttribute('aria-pressed') === 'true'")
                    page.run("document.querySelector('main').scrollTo(0, 0), scrollTo(0, 0)")
                    page.wait(DRAWN)
                    page.screenshot(SHOTS / f"clay-{name}-{craft}.png")
                    for both in ("#view", "#clay-hold"):
                        self.assertTrue(page.is_seen(both), f"{both} is on the screen")
                    self.assertLessEqual(page.run("document.documentElement.scrollWidth"), screen["width"], "nothing is cut off at the side")
                    self.assertEqual(page.unnamed_controls(), [], "every control has a name")
                    self.assertEqual(page.poor_contrasts(), [], "text can be read")
                    if screen.get("touch"):
                        self.assertEqual(page.small_targets(44), [], "a finger meets every control")
                # Also where the brush is set.
                page.run("document.querySelector('#slider-clay_brush_m').scrollIntoView({ block: 'nearest' })")
                page.screenshot(SHOTS / f"clay-{name}-scrolled.png")
                self.assertTrue(page.is_seen("#slider-clay_brush_m"), "the brush can be set")
                if screen["width"] < 800:
                    self.assertTrue(page.is_seen("#view"), "the picture stays")

    def test_clay_by_finger_and_pen(self):
        run, page = self.sculpt(**SCREENS["phone"])
        x, y = page.middle_of("#view")
        top = "document.querySelector('#view').getBoundingClientRect().top"

        def looks(moves):
            before = page.picture_of("#view")
            moves()
            page.wait(DRAWN)
            self.assertNotEqual(page.picture_of("#view"), before)

        def orbit():
            page.touch("Start", (x, y))
            for n in range(1, 5):
                page.touch("Move", (x + 12 * n, y + 8 * n))
            page.touch("End")

        def pinch():
            page.touch("Start", (x - 20, y))
            page.touch("Start", (x - 20, y), (x + 20, y))
            for n in range(1, 5):
                page.touch("Move", (x - 20 - 6 * n, y), (x + 20 + 6 * n, y))
            page.touch("End")

        def draw_across():
            page.pen("mousePressed", (x, y))
            page.pen("mouseMoved", (x + 50, y))
            page.pen("mouseReleased", (x + 50, y))

        # What moves in the scene is not what makes the difference: the hand rests in between, and the eye moves.
        page.click("#disable")
        page.wait(f"{WORD} === 'Disabled'")
        # Notes above the picture have come and gone.
        top_before = page.run(top)
        for moves in (orbit, pinch, draw_across):
            looks(moves)
        self.assertEqual(page.run(top), top_before, "a finger on the picture does not scroll")
        page.click("#enable")
        page.wait(f"{WORD} === 'Enabled'")

        self.choose(run, page, "pull")
        at = page.middle_of("#clay-hold")
        finger = lambda: page.touch("Start", at), lambda: page.touch("End")
        fell_silent = "document.querySelector('#events').textContent.split('fell silent').length - 1"
        for _ in range(6):
            times = page.run(fell_silent)
            self.hold(run, page, *finger)
            # Longer than a menu takes to come up, and off the button: a finger that slips still holds.
            page.touch("Move", (at[0] + 30, at[1] - 60))
            stood_still_ms = page.run(LONGEST_STANDSTILL_MS)
            is_held = run.get("clay")["is_held"]
            # A page that stood still, or a server that did, may have let go.
            if is_held or (stood_still_ms < 500 and page.run(fell_silent) == times):
                break
            page.touch("End")
            page.wait(IS_FREE)
        self.assertTrue(is_held, f"the page stood still for {stood_still_ms} ms")
        page.touch("End")
        page.wait(IS_FREE)
        self.hold(run, page, lambda: page.pen("mousePressed", at), lambda: page.pen("mouseReleased", at))
        page.pen("mouseReleased", at)
        page.wait(IS_FREE)
        # The system takes the finger away.
        self.hold(run, page, *finger)
        page.touch("Cancel")
        page.wait(IS_FREE)

    def test_clay_says_why_nothing_can_be_done(self):
        run, page = self.sculpt()
        hold = "document.querySelector('#clay-hold')"
        idle = "document.querySelector('#clay-idle').textContent"
        self.choose(run, page, "push")
        page.wait(f"{hold}.matches(':disabled') && {idle}.includes('without Hold')")
        self.choose(run, page, "pull")
        page.wait(f"!{hold}.matches(':disabled') && {idle} === ''")
        page.click("#disable")
        page.wait(f"{hold}.matches(':disabled') && {idle}.includes('no force flows')")
        self.assertFalse(page.run("document.querySelector('#clay-undo').matches(':disabled') && document.querySelector('#clay-file').matches(':disabled')"))
        page.click("#enable")
        page.wait(f"!{hold}.matches(':disabled')")
        # Another client holds, from this very page, as another one would hide it.
        page.run(
            """new Promise((done) => {
              window.other = new WebSocket(new URL('/api/v1/ws', location.href.replace('http', 'ws')));
              window.say = (held) => other.send(JSON.stringify({ do: 'clay_hold', held }));
              other.onmessage = () => { other.onmessage = null; setInterval(() => other.send('{"do": "ping"}'), 200); say(true); done(); };
            })"""
        )
        page.wait(f"{hold}.matches(':disabled') && {idle}.includes('Another client')")
        page.run("say(false)")
        page.wait(f"!{hold}.matches(':disabled')")

    def test_stop_with_unsaved_clay(self):
        run, page = self.sculpt(complains=True)
        busy = "document.querySelector('#clay-busy').textContent"
        asked = "!document.querySelector('#unsaved').hidden"
        self.choose(run, page, "paint")
        page.wait(f"{busy} === 'not saved'")
        page.click("#stop")
        page.wait(asked)
        page.wait(f"{WORD} === 'Disabled'")
        page.wait(f"{number('read-force')} === 0")
        self.assertEqual(page.run("document.activeElement.id"), "unsaved-save")
        self.assertEqual(page.poor_contrasts(), [], "text can be read")
        page.screenshot(SHOTS / "clay-unsaved.png")
        page.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
        page.wait("innerWidth === 390")
        page.wait(DRAWN)
        page.screenshot(SHOTS / "clay-unsaved-phone.png")
        for control in ("#disable", "#stop", "#unsaved-save", "#unsaved-stop", "#unsaved-go-on"):
            self.assertTrue(page.is_seen(control), f"{control} is on the screen of a phone")
        page.call("Emulation.setDeviceMetricsOverride", width=1440, height=900, deviceScaleFactor=1, mobile=False)
        page.wait("innerWidth === 1440")
        page.click("#unsaved-go-on")
        self.assertFalse(page.run(asked))
        self.assertIsNone(run.process.poll(), "the run goes on")

        page.click("#stop")
        page.click("#unsaved-save")
        page.wait("document.querySelector('#lost').textContent.includes('The run is over')")
        self.assertEqual(run.process.wait(timeout=30), 0)
        (kept,) = (self.folder / "state" / "hapticd" / "clay").glob("session-*.session")
        self.assertIn(str(kept), page.run("document.querySelector('#lost').textContent"))
        # Nothing looks as if it could still be done.
        for control in ("#clay-hold", "#clay-undo", "#clay-crafts button", "#clay-save button", "#clay-file", "#slider-clay_brush_m"):
            self.assertTrue(page.run(f"document.querySelector('{control}').matches(':disabled')"), control)
        self.assertIn("The run is over", page.run("document.querySelector('#clay-off').textContent"))
        page.screenshot(SHOTS / "clay-over.png")

    def test_stop_with_nothing_to_lose(self):
        """A stroke that is saved, or will be: the page does not ask. And one that may be lost."""
        # A test that is played once more finds none of before.
        session = pathlib.Path(tempfile.mkdtemp(dir=self.folder)) / "at-the-end.session"
        run, page = self.sculpt(options=["--session", str(session)], complains=True)
        self.choose(run, page, "paint")
        page.wait("document.querySelector('#clay-busy').textContent === 'saved at the end'")
        page.click("#stop")
        self.assertEqual(run.process.wait(timeout=30), 0)
        page.wait(f"document.querySelector('#lost').textContent.includes('{session}')")
        self.assertTrue(session.exists())

        run, page = self.sculpt(complains=True)
        self.choose(run, page, "paint")
        page.wait("document.querySelector('#clay-busy').textContent === 'not saved'")
        page.click("#stop")
        page.click("#unsaved-stop")
        self.assertEqual(run.process.wait(timeout=30), 0)
        page.wait("document.querySelector('#lost').textContent.startsWith('The run is over. This page')")

    def test_a_rigid_scene_shows_nothing_of_clay(self):
        run = self.run_scene("rest")
        page = self.open(run)
        page.wait("new Promise((done) => setTimeout(() => done(true), 500))")
        self.assertTrue(page.run("document.querySelector('#clay-box').hidden && document.querySelector('#legend-brush').hidden"))

    def test_view_follows_the_mouse(self):
        run = self.run_scene("rest")
        page = self.open(run)
        before = page.picture_of("#view")
        page.drag((500, 400), (600, 450))
        page.wait(DRAWN)
        turned = page.picture_of("#view")
        self.assertNotEqual(turned, before)
        page.click("#see-through")
        page.wait(DRAWN)
        clear = page.picture_at_rest("#view")
        self.assertNotEqual(clear, turned)

        # A graphics card may forget everything.
        page.run("window.loss = document.querySelector('#view').getContext('webgl2').getExtension('WEBGL_lose_context'), loss.loseContext()")
        page.wait("new Promise((done) => setTimeout(() => done(true), 200))")
        page.run("loss.restoreContext()")
        # Meshes and shaders are made anew, which takes a busy machine a while.
        for _ in range(20):
            page.wait("new Promise((done) => setTimeout(() => done(true), 500))")
            if page.difference(page.picture_of("#view"), clear) <= ROUNDING:
                break
        self.assertLessEqual(page.difference(page.picture_of("#view"), clear), ROUNDING)

    def test_modules(self):
        """What the modules reckon, without a picture."""
        run = self.run_scene("rest")
        page = self.open(run)
        self.assertEqual(
            page.run("import('/web/math.js').then(({ ceilTo125 }) => [0, 0.013, 0.2, 3, 5, 5.1, 70].map(ceilTo125))"),
            [0, 0.02, 0.2, 5, 5, 10, 100],
        )
        turned = page.run("import('/web/math.js').then(({ rotate }) => rotate([0, 0, Math.SQRT1_2, Math.SQRT1_2], [1, 0, 2]))")
        for found, expected in zip(turned, [0, 1, 2]):
            self.assertAlmostEqual(found, expected)
        # The nearest orientation along the axes: half turns, quarter turns, thirds of a turn about a diagonal.
        nearest = page.run(
            """import('/web/math.js').then(({ angleBetween, normalize, squared, turnAbout, turned }) =>
              [[[1, 0, 0], Math.PI], [[0, -1, 0], Math.PI / 2], [[1, 1, -1], (2 * Math.PI) / 3], [[1, 1, 0], Math.PI], [[0, 0, 1], 0]].map(([axis, angle]) => {
                const straight = turnAbout(normalize(axis), angle);
                return angleBetween(squared(turned(turnAbout(normalize([3, -2, 5]), 0.4), straight)), straight);
              }))"""
        )
        self.assertLess(max(nearest), 1e-6)
        # A cube as STL has it, every corner of every triangle a vertex of its own: 12 sharp edges, no diagonal, flat faces.
        cube = page.run(
            """import('/web/mesh.js').then(({ prepare }) => {
              const positions = [];
              for (let axis = 0; axis < 3; axis += 1) for (const side of [0, 1]) {
                const at = (u, v) => { const p = []; p[axis] = side ? 1 : -0; p[(axis + 1) % 3] = u; p[(axis + 2) % 3] = v; return p; };
                const quad = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
                if (!side) quad.reverse();
                positions.push(quad[0], quad[1], quad[2], quad[0], quad[2], quad[3]);
              }
              const mesh = prepare({ positions: new Float32Array(positions.flat()), indices: Uint32Array.from(positions.keys()) });
              return { edges: mesh.edges.length / 6, min: mesh.min, max: mesh.max, normals: [...mesh.normals] };
            })"""
        )
        self.assertEqual(cube["edges"], 12)
        self.assertEqual((cube["min"], cube["max"]), ([0, 0, 0], [1, 1, 1]))
        self.assertEqual({tuple(sorted(map(abs, cube["normals"][n : n + 3]))) for n in range(0, 144, 4)}, {(0, 0, 127)})
        # More rows than it keeps, and a loop that begins anew.
        kept = page.run(
            """import('/web/history.js').then(({ History }) => {
              const history = new History();
              for (let n = 0; n < 70000; n += 1) history.push([[n / 1000, n, null, 1, 2]]);
              const row = history.since(10);
              const full = [history.n - history.first, history.at(row, 0), history.at(row, 1)];
              history.push([[0.5, 7, 0, 1, 2]]);
              return [...full, history.n, history.end];
            })"""
        )
        self.assertEqual(kept, [65536, 10, 10000, 1, 0.5])

    def test_late_ticks(self):
        """Crowds of them are one line."""
        run = self.run_scene("rest")
        page = self.open(run)
        lines = page.run(
            """import('/web/facts.js').then(({ addEvent }) => {
              const late = (n, time_ns) => addEvent({ event: 'overrun', text: `${n} ticks began late`, names: [String(n)], time_ns }, null);
              const list = document.querySelector('#events');
              list.replaceChildren();
              late(3, 24.1e9);
              late(30, 24.2e9);
              late(4, 24.3e9);
              addEvent({ event: 'link', text: 'something else', names: [], time_ns: 25e9 }, null);
              late(1, 26e9);
              return [...list.children].map((line) => line.textContent);
            })"""
        )
        self.assertEqual(lines, ["26.00 s1 ticks began late", "25.00 ssomething else", "24.30 s37 ticks began late since 24.10 s"])

    def test_snippet(self):
        """examples/browser, served by another server than hapticd."""
        quiet = functools.partial(QuietFiles, directory=str(REPOSITORY / "examples" / "browser"))
        with http.server.ThreadingHTTPServer(("127.0.0.1", 0), quiet) as files:
            threading.Thread(target=files.serve_forever, daemon=True).start()
            origin = f"http://127.0.0.1:{files.server_port}"
            press = (self.folder / "press.toml").read_text()
            (self.folder / "snippet.toml").write_text(f'{press}\n[monitor]\norigins = ["{origin}"]\n')
            run = self.run_scene("snippet")
            server = run.url.removeprefix("http://").rstrip("/")
            page = self.browser.open(f"{origin}/force.html?server={server}")
            self.addCleanup(page.close)
            page.wait("parseFloat(document.querySelector('#force').textContent) > 0.5")
            self.assertEqual(page.complaints(), [])
            files.shutdown()


class QuietFiles(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


if __name__ == "__main__":
    unittest.main(verbosity=2)
