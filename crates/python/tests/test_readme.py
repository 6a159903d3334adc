"""The example of the README prints what the README says; every name has a text, and calls have examples that hold."""

import contextlib
import doctest
import inspect
import io
import re
import warnings
from pathlib import Path

import hapticd_vps as vps
import numpy as np
import pytest
from conftest import BLOCK, CUBE, ROOT


def test_the_example_prints_what_the_readme_says(monkeypatch: pytest.MonkeyPatch) -> None:
    found = re.search(r"```python\n(.*?)```\n\n```text\n(.*?)```", Path(ROOT / "crates/python/README.md").read_text(), re.S)
    assert found
    monkeypatch.chdir(ROOT)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(found[1], {})
    assert printed.getvalue() == found[2]


def test_every_public_name_has_a_text() -> None:
    for name in vps.__all__:
        item = getattr(vps, name)
        if isinstance(item, type):
            members = [member for member in vars(item) if not member.startswith("_")]
            assert item.__doc__ and all(vars(item)[member].__doc__ for member in members), name
            # Calls have a signature as well.
            calls = [getattr(item, member) for member in members if callable(getattr(item, member))]
            assert all(inspect.signature(call) for call in calls), name


def test_examples_of_the_texts_hold(block: vps.Voxmap, cube: vps.PointShell, query: vps.ContactQuery, tmp_path: Path) -> None:
    deep = [-0.005, -0.005, 0.0095, 0, 0, 0, 1]
    parts = {"block": block, "cube": cube, "query": query, "block_mesh": BLOCK, "cube_mesh": CUBE, "deep": deep, "folder": tmp_path}
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL)
    # Numbers print alike in every version.
    with np.printoptions(legacy="1.25"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in ("Mesh", "Voxmap", "PointShell", "ContactQuery"):
            kind = getattr(vps, name)
            calls = [member for member in vars(kind) if not member.startswith("_") and callable(getattr(kind, member))]
            texts = {name: kind.__doc__} | {f"{name}.{call}": getattr(kind, call).__doc__ for call in calls}
            if name == "ContactQuery":
                texts["ContactQuery.error_m"] = vars(kind)["error_m"].__doc__
            for place, text in texts.items():
                example = doctest.DocTestParser().get_doctest(text, vars(vps) | parts, place, None, None)
                assert example.examples, f"{place} has no example"
                printed: list[str] = []
                assert runner.run(example, out=printed.append).failed == 0, "".join(printed)
