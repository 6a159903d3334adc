"""Makes the pictures of docs/reference/gallery.md that show the monitor page, and frames of the moving one of the README.

    HAPTICD=target/release/hapticd python3 tests/browser/pictures.py DIR [SCENE... | frames]

Real runs on the real clock: where a picture is taken follows what the page shows, not the time. Frames of the peg go to DIR/frames: the mouse drags it along
one axis after the other into its hole, a step before each picture; any program makes a GIF of them."""

import csv
import os
import pathlib
import shutil
import sys
import tempfile
import time

from chromium import Chromium
from hapticd import REPOSITORY, Hapticd

PROGRAM = os.path.realpath(os.environ["HAPTICD"])
SCREEN = {"width": 1000, "height": 1180}
CONTACTS = "Number(document.querySelector('#read-contacts').textContent)"
FORCE = "Number(document.querySelector('#read-force').textContent)"
SHIPPED = REPOSITORY / "config" / "scenes"
# What has to be on the page, how long to wait from then on, how much nearer to look, and what the run is given.
SCENES = {
    "block-on-plane": (f"{CONTACTS} > 100", 0.0, 0, ["--hand-repeat"]),
    "lift-with-block": (f"{FORCE} > 1.5", 0.0, 0, ["--move", "lift=moves/lift.csv"]),
    "peg-in-hole": (f"{CONTACTS} > 200", 0.0, 1, ["--hand-repeat"]),
    "gear-on-shaft": (f"{CONTACTS} > 50", 1.5, 1, ["--hand-repeat"]),
    "nut-on-bolt": (f"{CONTACTS} > 50", 2.0, 0, []),
}
# Files of poses that a browser is too slow for, and how many times as long they take here. The lift rises only once.
SLOWER = {"hands/block-on-plane.csv": 10, "moves/lift.csv": 10}
# The way of the peg: axis, where it is to be on it, mm, and how far the mouse goes in a step, pixels.
WAY = (("x", 0.2, 10), ("y", 0.1, 10), ("z", -19.8, 9))
MOST_STEPS = 60


def open_page(browser, run, sees_through, nearer):
    """The page of a run that renders, zoomed in, without the buttons over the picture."""
    page = browser.open(run.url, **SCREEN)
    page.wait("document.querySelector('#view-note').textContent === ''")
    page.wait("document.querySelector('#state-word').textContent === 'Enabled'")
    if sees_through:
        page.click("#see-through")
    page.run("document.querySelector('#view').focus()")
    for _ in range(nearer):
        page.press("+")
    page.run("document.activeElement.blur()")
    page.run("document.querySelectorAll('.view button').forEach((button) => { button.style.visibility = 'hidden'; })")
    return page


def slowed(folder):
    """A copy of the shipped scenes with slower poses."""
    shutil.copytree(REPOSITORY / "config", folder / "config")
    scenes = folder / "config" / "scenes"
    for name, times in SLOWER.items():
        with open(scenes / name, newline="") as file:
            head, *rows = csv.reader(file)
        with open(scenes / name, "w", newline="") as file:
            csv.writer(file).writerows([head, *([repr(float(t) * times), *pose] for t, *pose in rows)])
    return scenes


def picture(browser, scenes, name, folder):
    """One scene at a moment that shows what it is about."""
    is_there, later_s, nearer, options = SCENES[name]
    with Hapticd(PROGRAM, scenes / f"{name}.toml", "--duration", "60s", *options) as run:
        page = open_page(browser, run, sees_through=name == "peg-in-hole", nearer=nearer)
        shot = None
        while shot is None or not page.run(is_there):
            page.wait(is_there)
            time.sleep(later_s)
            shot = page.picture_of("#view")
        (folder / f"scene-{name}.png").write_bytes(shot)
        page.close()


def frames(browser, folder):
    """The peg, dragged into its hole by the mouse alone."""
    folder.mkdir(exist_ok=True)
    text = (SHIPPED / "peg-in-hole.toml").read_text().replace("../models", str(REPOSITORY / "config" / "models"))
    scene = folder / "peg-in-hole.toml"
    scene.write_text("\n".join(line for line in text.splitlines() if not line.startswith("hand =")))
    with Hapticd(PROGRAM, scene, "--duration", "10min") as run:
        page = open_page(browser, run, sees_through=True, nearer=1)
        pictures = 0

        def mouse(kind, at):
            page.call("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", buttons=int(kind != "mouseReleased"), clickCount=1)

        def shoot():
            nonlocal pictures
            # The hand slows down in front of the cursor.
            time.sleep(0.5)
            (folder / f"{pictures:03}.png").write_bytes(page.picture_of("#view"))
            pictures += 1

        def handle(axis):
            """Where the handle for an axis begins and which way it points, window pixels."""
            line = f"document.querySelector('#hand-overlay [data-axis={axis}]')"
            x, y = page.run("(({ x, y }) => [x, y])(document.querySelector('#view').getBoundingClientRect())")
            x1, y1, x2, y2 = (float(page.run(f"{line}.getAttribute('{name}')")) for name in ("x1", "y1", "x2", "y2"))
            size = ((x2 - x1) ** 2 + (y2 - y1) ** 2) ** 0.5
            return (x + x1, y + y1), ((x2 - x1) / size, (y2 - y1) / size)

        shoot()
        (x, y), (dx, dy) = handle("x")
        at = (x - 28 * dx, y - 28 * dy)
        mouse("mousePressed", at)
        for n, (axis, wanted_mm, pixels) in enumerate(WAY):
            page.press(axis)
            for _ in range(MOST_STEPS):
                here_mm = 1e3 * run.get("state")["tool_cp"]["p"][n]
                if abs(here_mm - wanted_mm) < 0.4 or (n == 2 and here_mm < wanted_mm):
                    break
                _, way = handle(axis)
                step = pixels if abs(here_mm - wanted_mm) > 3 else 2
                step = -step if here_mm > wanted_mm else step
                at = (at[0] + step * way[0], at[1] + step * way[1])
                mouse("mouseMoved", at)
                shoot()
        shoot()
        mouse("mouseReleased", at)
        shoot()
    scene.unlink()


def main(folder, *wanted):
    folder.mkdir(parents=True, exist_ok=True)
    with Chromium() as browser, tempfile.TemporaryDirectory() as copy:
        slow = slowed(pathlib.Path(copy))
        for name in wanted or [*SCENES, "frames"]:
            if name == "frames":
                frames(browser, folder / "frames")
            else:
                picture(browser, slow if "block" in name else SHIPPED, name, folder)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), *sys.argv[2:])
