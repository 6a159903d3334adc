"""What tests of the monitor page share: one browser, scenes in a folder, runs and their pages."""

import os
import pathlib
import shutil
import tempfile
import unittest

from chromium import Chromium
from hapticd import Hapticd, write_scenes

PROGRAM = os.environ["HAPTICD"]
SHOTS = pathlib.Path(os.environ["SHOTS"])

SCREENS = {
    "desktop-light": {"width": 1440, "height": 900},
    "desktop-dark": {"width": 1440, "height": 900, "dark": True},
    "tablet": {"width": 820, "height": 1180, "touch": True},
    "phone": {"width": 390, "height": 844, "touch": True},
}
WORD = "document.querySelector('#state-word').textContent"
IN_CONTACT = "Number(document.querySelector('#read-contacts').textContent) > 0"
VIEW_IS_READY = "document.querySelector('#view-note').textContent === ''"


def number(id):
    """Script for the number that an element shows."""
    return f"Number(document.querySelector('#{id}').textContent.replace('−', '-'))"


class PageCase(unittest.TestCase):
    """Runs on the simulated arm, and pages of theirs."""

    @classmethod
    def setUpClass(cls):
        cls.browser = Chromium()
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="hapticd-scenes-"))
        write_scenes(cls.folder)

    @classmethod
    def tearDownClass(cls):
        cls.browser.__exit__()
        shutil.rmtree(cls.folder)

    def run_scene(self, name, *options, **more):
        run = Hapticd(PROGRAM, self.folder / f"{name}.toml", *options, **more)
        self.addCleanup(run.__exit__)
        return run

    def open(self, run, complains=False, **screen):
        return self.open_url(run.url, complains, **screen)

    def open_url(self, url, complains=False, **screen):
        page = self.browser.open(url, **(screen or SCREENS["desktop-dark"]))
        self.addCleanup(page.close)
        if not complains:
            self.addCleanup(lambda: self.assertEqual(page.complaints(), [], "the console is clean"))
        page.wait(VIEW_IS_READY)
        page.wait(f"{WORD} === 'Enabled'")
        return page
