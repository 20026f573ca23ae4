"""Tests that the Python readers of MCAP read what `palpate run --record FILE.mcap` writes."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

KINDS = {5: "<u4", 8: "<f8"}


def test_the_log_has_every_tick_and_the_contacts_of_every_step(tmp_path: Path, scene: str) -> None:
    reader: Any = pytest.importorskip("mcap.reader")
    decoder: Any = pytest.importorskip("mcap_protobuf.decoder")
    (tmp_path / "scene.toml").write_text(scene)
    words = ["run", "scene.toml", "--haptics", "scripted", "--seconds", "1", "--record", "log.mcap", "--out", "out"]
    done = subprocess.run([sys.executable, "-m", "palpate", *words], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    topics: dict[str, list[Any]] = {}
    with (tmp_path / "log.mcap").open("rb") as file:
        messages = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()]).iter_decoded_messages()
        for _, channel, message, decoded in messages:
            topics.setdefault(channel.topic, []).append((message.log_time, decoded))
    haptics = json.loads((tmp_path / "out" / "summary.json").read_text())["haptics"]
    ticks = [tick for _, tick in topics["/tick"]]
    assert [tick.tick for tick in ticks] == list(range(haptics["ticks"])) and haptics["ticks"] > 100
    assert all(at == round(1e9 * tick.time_s) for at, tick in topics["/tick"])
    end = ticks[-1]
    played = np.linalg.norm([end.played_force_x, end.played_force_y, end.played_force_z])
    assert played == pytest.approx(haptics["end"]["played_force_n"]) and played > 0.1
    for (_, pose), tick in zip(topics["/tool"], ticks, strict=True):
        assert pose.pose.position.y == tick.tool_y
    # The forces of the contacts sum to the reaction of the contact force on the tool.
    steps = [step for _, step in topics["/step"]]
    assert len(steps) == len(topics["/contacts"]) > 10
    greatest = max(abs(step.force_y) for step in steps)
    for (at_step, step), (at, cloud) in zip(topics["/step"], topics["/contacts"], strict=True):
        assert at == at_step == round(1e9 * step.held_time_s)
        names, offsets = [field.name for field in cloud.fields], [field.offset for field in cloud.fields]
        formats = [KINDS[field.type] for field in cloud.fields]
        kind = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": cloud.point_stride})
        points = np.frombuffer(cloud.data, kind)
        on_tool = np.where(points["body"] == 1, points["force_y"], -points["force_y"]).sum()
        assert on_tool == pytest.approx(step.force_y, abs=1e-4 * greatest)
    assert greatest > 0.1
