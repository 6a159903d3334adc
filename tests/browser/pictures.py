"""Makes the pictures of docs/reference/gallery.md that show the monitor page, and frames of the moving one of the README.

    HAPTICD=target/release/hapticd python3 tests/browser/pictures.py DIR [SCENE... | frames]

Real runs on the real clock: where a picture is taken follows what the page shows, not the time. Frames of the peg go to DIR/frames, with a hand that is
forty times slower than the shipped one, as a browser without a graphics card draws once in a second or two; any program makes a GIF of them."""

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
SLOWER = {"hands/peg-in-hole.csv": 40, "hands/block-on-plane.csv": 10, "moves/lift.csv": 10}
PEG_S = 4.2


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


def frames(browser, scenes, folder):
    """The way of the peg into its hole, as often as the browser can draw."""
    folder.mkdir(exist_ok=True)
    with Hapticd(PROGRAM, scenes / "peg-in-hole.toml", "--duration", "10min") as run:
        page = open_page(browser, run, sees_through=True, nearer=1)
        end = time.monotonic() + PEG_S * SLOWER["hands/peg-in-hole.csv"]
        n = 0
        while time.monotonic() < end:
            (folder / f"{n:03}.png").write_bytes(page.picture_of("#view"))
            n += 1


def main(folder, *wanted):
    folder.mkdir(parents=True, exist_ok=True)
    with Chromium() as browser, tempfile.TemporaryDirectory() as copy:
        slow = slowed(pathlib.Path(copy))
        for name in wanted or [*SCENES, "frames"]:
            if name == "frames":
                frames(browser, slow, folder / "frames")
            else:
                picture(browser, slow if "block" in name else SHIPPED, name, folder)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), *sys.argv[2:])
