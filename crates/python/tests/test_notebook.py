"""The code of the notebook runs, and its plots say what the parts are."""

import json
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from conftest import ROOT

matplotlib.use("Agg")


def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib.pyplot as plt

    monkeypatch.setattr(plt, "show", lambda: None)
    monkeypatch.chdir(ROOT / "crates/python/notebooks")
    notebook = json.loads(Path("peg_in_hole.ipynb").read_text())
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    names["figure"].savefig(tmp_path / "plot.png", dpi=80)

    x_m, found = names["x_m"], names["sideways"]
    force_n = found["force_n"][:, 0]
    # 0.05 mm of play: nothing pushes in the middle, and beyond it the wall that was run into pushes back.
    free, pressed = np.abs(x_m) < 4e-5, np.abs(x_m) > 6e-5
    assert not force_n[free].any() and (force_n[pressed] * x_m[pressed] < 0).all()
    assert found["clearance_m"].max() == pytest.approx(5e-5, abs=5e-6)
    assert found["penetration_m"].max() == pytest.approx(np.abs(x_m).max() - 5e-5, abs=1e-5)
    assert (found["penetration_m"] * found["clearance_m"] == 0).all()
    torque_nm = names["tilted"]["torque_nm"][:, 1]
    assert torque_nm[0] != 0 and torque_nm[-1] != 0 and not torque_nm[len(torque_nm) // 2]
    for axis in names["figure"].axes:
        assert all(np.isfinite(line.get_ydata()).all() and np.ptp(line.get_ydata()) > 0 for line in axis.lines) and axis.lines
