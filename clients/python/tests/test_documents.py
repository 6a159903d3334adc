"""What the package knows of the protocol is what its documents say."""

from __future__ import annotations

import dataclasses
import re

from conftest import REPOSITORY

from hapticd import STATE_DTYPE, ClayFacts, State, fault_names
from hapticd.state import FAULTS, OFF_CAUSES

API = (REPOSITORY / "docs" / "reference" / "api.md").read_text()


def section(number: int) -> str:
    return API.split(f"\n## {number}. ")[1].split("\n## ")[0]


def first_column(text: str) -> list[str]:
    return [name for row in re.findall(r"^\| (`.*?) \|", text, flags=re.M) for name in re.findall(r"`(\w+)`", row)]


def test_a_state_has_every_documented_key() -> None:
    assert set(first_column(section(5))) - {"type"} == {field.name for field in dataclasses.fields(State)}


def test_facts_of_clay_are_documented_ones() -> None:
    documented = set(first_column(section(12).split("| over WebSocket")[0]))
    named = {field.name for field in dataclasses.fields(ClayFacts)}
    assert named <= documented and len(named) > 15, named - documented


def test_the_binary_layout_is_the_documented_one() -> None:
    rows = re.findall(r"^\| (\d+) \| (\w+) ?(?:× (\d+)|bytes)? \| (.+?) \|$", section(6), flags=re.M)
    assert len(rows) > 15
    fields = STATE_DTYPE.fields
    assert fields is not None
    n_bytes = {"4": 4, "u32": 4, "u64": 8, "i64": 8, "f64": 8, "f32": 4}
    covered = 0
    for offset, kind, count, words in rows:
        assert int(offset) == covered, "the table has no holes"
        size = n_bytes[kind] * int(count or 1)
        here = [name for name, found in fields.items() if covered <= found[1] < covered + size]
        assert sum(fields[name][0].itemsize for name in here) == size, (words, here)
        names = [word for word in re.split(r"[:, ]+", words) if word in fields]
        assert names == here or here in (["magic"], ["flags"]), (words, here)
        covered += size
    assert covered == STATE_DTYPE.itemsize == int(re.search(r"(\d+) bytes, version 1", section(6))[1])  # type: ignore[index]


def test_causes_and_faults_are_the_documented_ones() -> None:
    causes = section(6).split("Off causes:")[1].split("A silence")[0]
    faults = section(6).split("Faults, from bit 0:")[1]
    assert [name for _, name in sorted((int(n), name) for n, name in re.findall(r"(\d+) `([\w-]+)`", causes))] == list(OFF_CAUSES)
    assert [name for _, name in sorted((int(n), name) for n, name in re.findall(r"(\d+) `([\w-]+)`", faults))] == list(FAULTS)
    assert fault_names(0b10010) == ("speed", "overrun") and fault_names(1 << 30) == ("bit-30",)


def test_the_ros_table_names_what_states_have() -> None:
    table = (REPOSITORY / "docs" / "reference" / "ros2.md").read_text().split("## From hapticd")[1].split("##")[0]
    named = re.findall(r"^\| `(\w+)` \| `", table, flags=re.M)
    assert len(named) > 10 and set(named) <= {field.name for field in dataclasses.fields(State)}
