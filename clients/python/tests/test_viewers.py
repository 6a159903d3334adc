"""The layout for Foxglove names what is in a recording."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from conftest import HUNG_S, LIFT, REPOSITORY
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from hapticd import Run

LAYOUT = REPOSITORY / "config" / "viewers" / "foxglove-layout.json"
NUMBERS = {FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_UINT32, FieldDescriptor.CPPTYPE_UINT64, FieldDescriptor.CPPTYPE_INT64}


@pytest.fixture(scope="module")
def channels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, Descriptor]]:
    """Schema of each topic of a fresh recording, and what its messages are made of."""
    file = tmp_path_factory.mktemp("viewers") / "lift.mcap"
    with Run(LIFT, "--cache", "off", "--duration", "1s", "--record", str(file), clock="virtual") as run:
        assert run.wait(HUNG_S) == 0, run.talk
    with open(file, "rb") as opened:
        summary = make_reader(opened).get_summary()
    assert summary is not None
    found = {}
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
        assert decode is not None
        found[channel.topic] = (schema.name, decode(b"").DESCRIPTOR)
    return found


def layout() -> dict[str, Any]:
    read: dict[str, Any] = json.loads(LAYOUT.read_text())
    return read


def leaves(node: str | dict[str, Any]) -> Iterator[str]:
    if isinstance(node, str):
        yield node
        return
    assert set(node) == {"direction", "first", "second", "splitPercentage"} and node["direction"] in ("row", "column")
    assert 0 < node["splitPercentage"] < 100
    yield from leaves(node["first"])
    yield from leaves(node["second"])


def field(path: str, channels: dict[str, tuple[str, Descriptor]]) -> FieldDescriptor:
    """The field that a message path such as `/wrench/contact.force.x` leads to."""
    topic, *names = path.split(".")
    assert topic in channels, path
    descriptor: Descriptor | None = channels[topic][1]
    found: FieldDescriptor | None = None
    for name in names:
        assert descriptor is not None and name in descriptor.fields_by_name, path
        found = descriptor.fields_by_name[name]
        descriptor = found.message_type
    assert found is not None and descriptor is None, f"{path} leads to a number or a word"
    return found


def test_every_panel_is_shown_once() -> None:
    read = layout()
    assert set(read) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    shown = list(leaves(read["layout"]))
    assert sorted(shown) == sorted(read["configById"]) and len(shown) > 5
    assert {panel.split("!")[0] for panel in shown} == {"3D", "Plot", "StateTransitions", "RosOut"}


def test_every_path_is_in_a_recording(channels: dict[str, tuple[str, Descriptor]]) -> None:
    read = layout()
    topics = set()
    for panel, config in read["configById"].items():
        kind = panel.split("!")[0]
        for path in config.get("paths", []):
            found = field(path["value"], channels)
            topics.add(path["value"].split(".")[0])
            assert path["enabled"] and path["label"]
            assert (found.cpp_type in NUMBERS) if kind == "Plot" else (found.enum_type is not None), path
        for topic in config.get("topics", {}):
            topics.add(topic)
            assert channels[topic][0] in ("foxglove.SceneUpdate", "foxglove.PoseInFrame")
        if kind == "RosOut":
            topics.add(config["topicToRender"])
            assert channels[config["topicToRender"]][0] == "foxglove.Log"
    assert topics == {"/scene", "/tool/pose", "/faults", "/wrench/contact", "/wrench/command", "/loop/timing", "/device/sample"}
    # No topic is named in another place where this test would not see it.
    assert set(re.findall(r'"(/[a-z/]+)', LAYOUT.read_text())) == topics


def test_a_path_that_is_not_there_is_found(channels: dict[str, tuple[str, Descriptor]]) -> None:
    for path in ("/wrench/contact.force.w", "/wrench/contact.force", "/wrench.force.x", "/wrench/contact"):
        with pytest.raises(AssertionError):
            field(path, channels)
