"""The example of the README prints what the README says, and every name has a text."""

import contextlib
import inspect
import io
import re
from pathlib import Path

import hapticd_vps as vps
import pytest
from conftest import ROOT


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
