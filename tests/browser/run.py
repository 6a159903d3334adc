"""Runs browser tests, several beside each other, each with a browser of its own. Started by scripts/browser-test.

    python3 run.py [--jobs N] TEST...

Most of what a test does is to wait for a run on the real clock; with two of them the other one waits, or draws, meanwhile. What fails is played once more, alone: a
run that was late, as its machine was, is no fault of the page; one of ours comes again."""

import argparse
import io
import queue
import sys
import threading
import time
import unittest

from page_case import Stage


def each(suite):
    """The single tests of a suite."""
    return [one for test in suite for one in (each(test) if isinstance(test, unittest.TestSuite) else [test])]


class Runner:
    """Takes tests from a queue, on as many threads as there are stages."""

    def __init__(self, tests):
        self.waiting = queue.SimpleQueue()
        for test in tests:
            self.waiting.put(test)
        self.failed = []
        self.skipped = 0
        self.writing = threading.Lock()

    def work(self, stage):
        stage.take()
        while not self.waiting.empty():
            try:
                test = self.waiting.get_nowait()
            except queue.Empty:
                return
            self.run(test)

    def run(self, test):
        text = io.StringIO()
        result = unittest.TextTestResult(unittest.runner._WritelnDecorator(text), descriptions=False, verbosity=0)
        begun = time.monotonic()
        test.run(result)
        took_s = time.monotonic() - begun
        with self.writing:
            self.skipped += len(result.skipped)
            word = "skipped" if result.skipped else "ok" if result.wasSuccessful() else "FAILED"
            print(f"{test.id()} ... {word} ({took_s:.1f} s)", flush=True)
            if not result.wasSuccessful():
                self.failed.append(test.id())
                result.printErrors()
                print(text.getvalue(), flush=True)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--jobs", type=int, default=2)
    arguments.add_argument("tests", nargs="+", metavar="TEST", help="as unittest takes them, such as test_page.PageTest.test_fault")
    given = arguments.parse_args()
    tests = each(unittest.defaultTestLoader.loadTestsFromNames(given.tests))
    begun = time.monotonic()
    runner = Runner(tests)
    # Browsers begin before there are threads: a process that has some cannot be forked safely.
    stages = [Stage() for _ in range(min(given.jobs, len(tests)))]
    threads = [threading.Thread(target=runner.work, args=(stage,)) for stage in stages]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    once_more, runner.failed = runner.failed, []
    stages[0].take()
    for name in once_more:
        print(f"once more: {name}")
        runner.run(each(unittest.defaultTestLoader.loadTestsFromName(name))[0])
    for stage in stages:
        stage.close()
    print(f"Ran {len(tests)} tests in {time.monotonic() - begun:.0f} s, {given.jobs} beside each other; {len(runner.failed)} failed, {runner.skipped} skipped", flush=True)
    for name in runner.failed:
        print(f"FAILED {name}")
    sys.exit(1 if runner.failed or not tests else 0)


if __name__ == "__main__":
    main()
