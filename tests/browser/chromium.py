"""A headless Chromium, driven over its DevTools protocol through a pair of pipes. Needs nothing but Chromium itself."""

import base64
import itertools
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import time

# Without a graphics card WebGL is drawn by the processor.
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-pipe",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--mute-audio",
    # A mouse, as on a desk; pages that emulate touch have none.
    "--blink-settings=primaryHoverType=2,availableHoverTypes=2,primaryPointerType=4,availablePointerTypes=4",
]
# Most that a processor draws here is looked at by none of the tests: all but WebGL is put together without WebGL's renderer, and a page that asks for every
# picture of a screen gets about one in five. Together they take a third less of the processor.
SPARING_FLAG = "--disable-gpu-compositing"
FEW_PICTURES = """(() => {
  const next = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (draw) => setTimeout(() => next(draw), 60);
  window.cancelAnimationFrame = clearTimeout;
})()"""
NAMES = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"]


def find():
    """Path of an installed Chromium: `CHROMIUM`, or the first known name on the path; None without one."""
    return os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)


class Chromium:
    """The browser process; `with Chromium() as browser` ends it and removes its profile. One that is sparing draws as little as tests need."""

    def __init__(self, is_sparing=False):
        self.is_sparing = is_sparing
        self.profile = tempfile.mkdtemp(prefix="hapticd-browser-")
        read_commands, self.commands = os.pipe()
        self.answers, write_answers = os.pipe()

        def on_3_and_4():
            # Both ends first out of the way of 3 and 4, which Chromium reads from and writes to.
            ends = [os.dup(read_commands), os.dup(write_answers)]
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        self.log = open(pathlib.Path(self.profile) / "stderr", "wb")
        self.process = subprocess.Popen(
            [find(), *FLAGS, *([SPARING_FLAG] if is_sparing else []), f"--user-data-dir={self.profile}", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=self.log,
            stderr=self.log,
            preexec_fn=on_3_and_4,
            close_fds=False,
        )
        os.close(read_commands)
        os.close(write_answers)
        self.ids = itertools.count(1)
        self.rest = b""
        self.events = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.close(self.commands)
        try:
            self.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.answers)
        self.log.close()
        shutil.rmtree(self.profile, ignore_errors=True)

    def call(self, method, session=None, **params):
        """One command and its result; what happened meanwhile goes to `events`."""
        id = next(self.ids)
        message = {"id": id, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self.commands, json.dumps(message).encode() + b"\0")
        while True:
            answer = self.receive()
            if answer.get("id") == id:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def receive(self):
        """The next message of the browser."""
        while b"\0" not in self.rest:
            got = os.read(self.answers, 1 << 16)
            if not got:
                raise RuntimeError("the browser is gone")
            self.rest += got
        message, self.rest = self.rest.split(b"\0", 1)
        return json.loads(message)

    def open(self, url, **screen):
        """A new page at an address."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        return Page(self, target, session, url, **screen)


class Page:
    """One page of the browser."""

    def __init__(self, browser, target, session, url, **screen):
        self.browser, self.target, self.session = browser, target, session
        self.is_closed = False
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.on_screen(**screen)
        if browser.is_sparing:
            self.call("Page.addScriptToEvaluateOnNewDocument", source=FEW_PICTURES)
        self.call("Page.navigate", url=url)
        self.wait("document.readyState === 'complete'")

    def on_screen(self, width=1440, height=900, scale=1, dark=False, touch=False):
        """From now on the page is on this screen: a window that gets another size, a tablet that is turned."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=touch)
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        self.call("Emulation.setTouchEmulationEnabled", enabled=touch, maxTouchPoints=5 if touch else 1)

    def call(self, method, **params):
        return self.browser.call(method, self.session, **params)

    def close(self):
        """Once is enough. A page that is left open draws on, whether it is looked at or not."""
        if not self.is_closed:
            self.is_closed = True
            self.browser.call("Target.closeTarget", targetId=self.target)

    def run(self, script):
        """The value of a script's expression, or of its promise."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{script}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def becomes(self, script, timeout_s):
        """The value of an expression once it is true; None if it does not become so."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            if value := self.run(script):
                return value
            time.sleep(0.05)
        return None

    def wait(self, script, timeout_s=90):
        """Waits until an expression is true, and returns its value."""
        value = self.becomes(script, timeout_s)
        if value is None:
            raise AssertionError(f"waited {timeout_s} s for: {script}\nthe page says: {self.run(SAID)}")
        return value

    def press(self, key, shift=False):
        """One key, as a keyboard sends it."""
        text = {"Enter": "\r", " ": " "}.get(key)
        modifiers = 8 if shift else 0
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, code=key, text=text or "", modifiers=modifiers, windowsVirtualKeyCode=KEYS.get(key, 0))
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=key, modifiers=modifiers, windowsVirtualKeyCode=KEYS.get(key, 0))

    def hold_key(self, key, is_down):
        """One half of a key."""
        text = {" ": " "}.get(key, "") if is_down else ""
        kind = "keyDown" if is_down else "keyUp"
        self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, text=text, windowsVirtualKeyCode=KEYS.get(key, 0))

    def undo_key(self, shift=False):
        """Ctrl+Z, or Ctrl+Shift+Z."""
        for kind in ("rawKeyDown", "keyUp"):
            modifiers = 2 + 8 * shift
            self.call("Input.dispatchKeyEvent", type=kind, key="z", code="KeyZ", modifiers=modifiers, windowsVirtualKeyCode=90)

    def click(self, selector):
        """A real click in the middle of an element, once that stands still; again where it has moved away between the press and the release."""
        for _ in range(5):
            x, y = self.run(AT_REST % json.dumps(selector))
            for kind in ("mousePressed", "mouseReleased"):
                self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
            if self.run("window.wasClicked?.() ?? true"):
                return
        raise AssertionError(f"{selector} moved away from five clicks")

    def drag(self, start, end):
        """The mouse from one point to another with its button down."""
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=start[0], y=start[1], button="left", buttons=1, clickCount=1)
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=end[0], y=end[1], button="left", buttons=1)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], button="left", clickCount=1)

    def middle_of(self, selector):
        """Where an element is, as it stands."""
        return self.run(f"(() => {{ const r = document.querySelector({json.dumps(selector)}).getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; }})()")

    def touch(self, kind, *fingers):
        """All fingers on the screen from now on: `Start` where one came, `Move`, `End` where all have left."""
        points = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(fingers)]
        self.call("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=points)

    def pen(self, kind, at):
        """A pen: `mousePressed`, `mouseMoved`, `mouseReleased`."""
        down = 0 if kind == "mouseReleased" else 1
        self.call("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", buttons=down, clickCount=1, pointerType="pen")

    def is_seen(self, selector):
        """Whether all of an element is on the screen, with nothing over its middle."""
        return self.run(
            f"""(() => {{
              const e = document.querySelector({json.dumps(selector)});
              const r = e.getBoundingClientRect();
              const top = document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2);
              return r.width > 0 && r.x >= 0 && r.y >= 0 && r.right <= innerWidth && r.bottom <= innerHeight && (top === e || e.contains(top));
            }})()"""
        )

    def picture_of(self, selector):
        """What an element looks like, as PNG bytes; two that are equal look alike."""
        x, y, width, height = self.run(
            f"(() => {{ const r = document.querySelector({json.dumps(selector)}).getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; }})()"
        )
        clip = {"x": x, "y": y, "width": width, "height": height, "scale": 1}
        return base64.b64decode(self.call("Page.captureScreenshot", format="png", clip=clip)["data"])

    def difference(self, one, other):
        """The largest difference of two pictures in any pixel and colour, of 255; 256 where they are not of one size."""
        return self.run(DIFFERENCE % tuple(json.dumps(base64.b64encode(png).decode()) for png in (one, other)))

    def picture_that_is_not(self, before, selector, timeout_s=30):
        """What an element looks like once it looks otherwise than before."""
        end = time.monotonic() + timeout_s
        while (now := self.picture_of(selector)) == before:
            if time.monotonic() > end:
                raise AssertionError(f"{selector} looked the same for {timeout_s} s")
        return now

    def picture_at_rest(self, selector, timeout_s=30):
        """What an element looks like once it does not change any more: controls over it fade for a while."""
        end = time.monotonic() + timeout_s
        before = None
        while (now := self.picture_of(selector)) != before:
            if time.monotonic() > end:
                raise AssertionError(f"{selector} looked otherwise each time for {timeout_s} s")
            before = now
            time.sleep(0.3)
        return now

    def count_pixels(self, selector, color):
        """How many pixels of the middle of an element have the hue of a custom property, or of a colour `#rrggbb`, lit or in shade."""
        png = base64.b64encode(self.picture_of(selector)).decode()
        return self.run(COUNT_PIXELS % (json.dumps(png), json.dumps(color)))

    def pixels_above(self, least, selector, color, timeout_s=30):
        """The same, of the first picture that has more than `least`."""
        end = time.monotonic() + timeout_s
        while (found := self.count_pixels(selector, color)) <= least:
            if time.monotonic() > end:
                raise AssertionError(f"{found} pixels of {color} in {selector} after {timeout_s} s, not more than {least}")
        return found

    def unnamed_controls(self):
        """Controls that a screen reader has no name for."""
        self.call("Accessibility.enable")
        nodes = self.call("Accessibility.getFullAXTree")["nodes"]
        roles = {"button", "link", "slider", "spinbutton", "textbox", "combobox", "checkbox", "DisclosureTriangle", "image", "region"}
        return [
            node["role"]["value"]
            for node in nodes
            if not node["ignored"] and node["role"]["value"] in roles and not node.get("name", {}).get("value")
        ]

    def small_targets(self, least):
        """Controls that are lower than a finger needs, in pixels. Links in running text may be."""
        return self.run(
            f"""[...document.querySelectorAll('button, select, input, summary')]
              .map((e) => [e.closest('label.check') ?? e, e.id || e.textContent])
              .filter(([e]) => e.checkVisibility() && e.getBoundingClientRect().height < {least})
              .map(([e, name]) => `${{name}}: ${{e.getBoundingClientRect().height}}`)"""
        )

    def poor_contrasts(self):
        """Texts with a contrast to their ground below 4.5 (WCAG 2.2, AA); 3 where they are large."""
        return self.run(POOR_CONTRASTS)

    def screenshot(self, path=None):
        """What the page looks like, as PNG bytes, also written to a file."""
        png = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path:
            pathlib.Path(path).write_bytes(png)
        return png

    def complaints(self):
        """Errors and warnings of the console, uncaught errors and failed loads of this page so far."""
        texts = []
        for event in self.browser.events:
            if event.get("sessionId") != self.session:
                continue
            method, params = event["method"], event["params"]
            if method == "Runtime.exceptionThrown":
                details = params["exceptionDetails"]
                texts.append(details.get("exception", {}).get("description") or details["text"])
            elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
                texts.append(" ".join(str(arg.get("value", arg.get("description"))) for arg in params["args"]))
            elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
                texts.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
        return texts


KEYS = {"Tab": 9, "Enter": 13, "Escape": 27, " ": 32, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Home": 36, "End": 35}

# Where the middle of an element is once it has been there for two frames; `wasClicked()` says whether it had a click since, and is gone with the page.
AT_REST = """new Promise((done) => {
  const e = document.querySelector(%s);
  e.scrollIntoView({ block: "nearest" });
  const middle = () => { const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; };
  const look = (before) => requestAnimationFrame(() => {
    const now = middle();
    if (now.join() !== before.join()) return look(now);
    let clicked = false;
    document.addEventListener("click", ({ target }) => { clicked ||= e.contains(target); }, { capture: true, once: true });
    window.wasClicked = () => clicked;
    done(now);
  });
  look(middle());
})"""

# What the page says, for the message of a test that fails.
SAID = """["state-word", "state-note", "toasts", "events", "clay-idle", "clay-off", "clay-busy"]
  .map((id) => `${id}: ${document.getElementById(id)?.textContent.trim() ?? ""}`).join("; ")"""

# The arrow is lit like all else: what stays is the order and the ratio of its channels.
DIFFERENCE = """(async () => {
  const [one, other] = await Promise.all([%s, %s].map(async (png) => {
    const image = await createImageBitmap(new Blob([Uint8Array.from(atob(png), (c) => c.charCodeAt(0))], { type: "image/png" }));
    const g = new OffscreenCanvas(image.width, image.height).getContext("2d");
    g.drawImage(image, 0, 0);
    return g.getImageData(0, 0, image.width, image.height);
  }));
  if (one.width !== other.width || one.height !== other.height) return 256;
  return one.data.reduce((most, value, k) => Math.max(most, Math.abs(value - other.data[k])), 0);
})()"""

COUNT_PIXELS = """(async () => {
  const bytes = Uint8Array.from(atob(%s), (c) => c.charCodeAt(0));
  const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
  const { width: w, height: h } = image;
  const g = new OffscreenCanvas(w, h).getContext("2d");
  g.drawImage(image, 0, 0);
  const hue = ([r, g, b]) => { const m = Math.max(r, g, b) || 1; return [r / m, g / m, b / m]; };
  const color = %s;
  const hex = parseInt((color.startsWith("#") ? color : getComputedStyle(document.documentElement).getPropertyValue(color).trim()).slice(1), 16);
  const wanted = hue([(hex >> 16) & 255, (hex >> 8) & 255, hex & 255]);
  // Without the buttons above, the legend below, and the axes in the corner.
  const { data } = g.getImageData(0.12 * w, 0.15 * h, 0.88 * w, 0.7 * h);
  let n = 0;
  for (let k = 0; k < data.length; k += 4) {
    const found = hue([data[k], data[k + 1], data[k + 2]]);
    if (Math.max(data[k], data[k + 1], data[k + 2]) > 90 && wanted.every((x, i) => Math.abs(x - found[i]) < 0.12)) n += 1;
  }
  return n;
})()"""

POOR_CONTRASTS = """(() => {
  const canvas = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const rgba = (css) => { canvas.clearRect(0, 0, 1, 1); canvas.fillStyle = css; canvas.fillRect(0, 0, 1, 1); return [...canvas.getImageData(0, 0, 1, 1).data]; };
  const linear = (byte) => { const x = byte / 255; return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4; };
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const ground = (e) => { for (; e; e = e.parentElement) { const c = rgba(getComputedStyle(e).backgroundColor); if (c[3] > 200) return c; } return [255, 255, 255]; };
  const poor = [];
  for (const e of document.querySelectorAll("body *")) {
    const hasText = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    // Disabled controls are exempt; text over the picture has no one ground.
    if (!hasText || !e.checkVisibility() || e.closest(":disabled, .view, option")) continue;
    const style = getComputedStyle(e);
    const [a, b] = [luminance(rgba(style.color)), luminance(ground(e))];
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const isLarge = parseFloat(style.fontSize) >= 24 || (parseFloat(style.fontSize) >= 18.6 && style.fontWeight >= 700);
    if (contrast < (isLarge ? 3 : 4.5)) poor.push(`${e.tagName} ${e.textContent.trim().slice(0, 30)}: ${contrast.toFixed(2)}`);
  }
  return poor;
})()"""
