"""The layouts of ROS 2 messages in docs/reference/ros2.md, held against messages that CDR libraries made."""

from __future__ import annotations

import json
import struct
from typing import Any

import pytest
from conftest import REPOSITORY

MESSAGES = json.loads((REPOSITORY / "tests/fixtures/cdr/messages.json").read_text())


class Bytes:
    """Reads by the rules of the document, which are those of its tables and nothing else."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def numbers(self, offset: int, form: str) -> list[Any]:
        return list(struct.unpack_from(f"<{form}", self.data, offset))

    def u32(self) -> int:
        self._skip_to(-(-self.at // 4) * 4)
        self.at += 4
        return int(self.numbers(self.at - 4, "I")[0])

    def u8(self) -> int:
        self.at += 1
        return self.data[self.at - 1]

    def string(self) -> str:
        n = self.u32() - 1
        self.at += n + 1
        assert self.data[self.at - 1] == 0
        return self.data[self.at - 1 - n : self.at - 1].decode()

    def doubles(self) -> list[float]:
        if (m := self.u32()) == 0:
            return []
        self._skip_to(4 + -(-(self.at - 4) // 8) * 8)
        self.at += 8 * m
        return self.numbers(self.at - 8 * m, f"{m}d")

    def _skip_to(self, offset: int) -> None:
        assert not any(self.data[self.at : offset]), "zeros between"
        self.at = offset


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: str(message["name"]))
def test_a_message_is_where_the_document_says(message: dict[str, Any]) -> None:
    fields, read = message["fields"], Bytes(bytes.fromhex(message["hex"]))
    frame_id = fields["header"]["frame_id"].encode()
    n = len(frame_id)
    assert read.data[:4] == bytes([0, 1, 0, 0])
    assert read.numbers(4, "iII") == [*fields["header"]["stamp"].values(), n + 1] and read.data[16 : 17 + n] == frame_id + b"\0"
    p = 4 + 8 * -(-(13 + n) // 8)
    read.at = 17 + n
    match message["type"].split("/")[-1]:
        case "PoseStamped":
            assert read.numbers(p, "3d") == list(fields["pose"]["position"].values())
            assert read.numbers(p + 24, "4d") == list(fields["pose"]["orientation"].values())
            read.at = p + 56
        case "TwistStamped" | "WrenchStamped":
            first, second = next(value for key, value in fields.items() if key != "header").values()
            assert read.numbers(p, "3d") == list(first.values()) and read.numbers(p + 24, "3d") == list(second.values())
            read.at = p + 48
        case "JointState":
            assert [read.string() for _ in range(read.u32())] == fields["name"]
            assert [read.doubles() for _ in range(3)] == [fields["position"], fields["velocity"], fields["effort"]]
        case "Joy":
            axes = read.u32()
            read.at += 4 * axes
            assert read.numbers(read.at - 4 * axes, f"{axes}f") == fields["axes"]
            buttons = read.u32()
            read.at += 4 * buttons
            assert read.numbers(read.at - 4 * buttons, f"{buttons}i") == fields["buttons"]
        case "OperatingState":
            assert read.string() == fields["state"]
            assert [read.u8(), read.u8()] == [fields["is_homed"], fields["is_busy"]]
        case "DiagnosticArray":
            assert statuses(read) == fields["status"]
        case other:
            raise AssertionError(f"docs/reference/ros2.md does not have {other}")
    assert read.at == len(read.data), "nothing behind the last field"


def statuses(read: Bytes) -> list[dict[str, Any]]:
    found = []
    for _ in range(read.u32()):
        status: dict[str, Any] = {"level": read.u8(), **{key: read.string() for key in ("name", "message", "hardware_id")}}
        status["values"] = [{"key": read.string(), "value": read.string()} for _ in range(read.u32())]
        found.append(status)
    return found


def test_every_kind_and_padding_is_there() -> None:
    assert len({message["type"] for message in MESSAGES}) == 7
    assert {len(message["fields"]["header"]["frame_id"]) % 8 for message in MESSAGES} >= {0, 1, 3, 4, 5, 6}
