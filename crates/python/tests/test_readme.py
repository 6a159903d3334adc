"""The example of the README prints what the README says."""

import contextlib
import io
import re
from pathlib import Path

import pytest
from conftest import ROOT


def test_the_example_prints_what_the_readme_says(monkeypatch: pytest.MonkeyPatch) -> None:
    found = re.search(r"```python\n(.*?)```\n\n```text\n(.*?)```", Path(ROOT / "crates/python/README.md").read_text(), re.S)
    assert found
    monkeypatch.chdir(ROOT)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(found[1], {})
    assert printed.getvalue() == found[2]
