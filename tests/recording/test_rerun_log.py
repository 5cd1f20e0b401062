"""Frame logs for Rerun: what its own reader finds in them."""

import sys
from collections import Counter

import numpy as np
import pytest

from proximity.errors import MissingLibraryError
from proximity.message import FRAME, ContactFlag, Message
from proximity.recording import FrameLog, FrameReader
from proximity.recording.rerun_log import ShownPart, write_rerun

FRAMES = 40


@pytest.fixture
def log(tmp_path):
    message = Message(FRAME, 2)
    message.records["finger"] = [0, 1]
    message.records["flags"] = [ContactFlag.TRACKED, 0]
    with FrameLog(tmp_path / "run.frames") as frames:
        for number in range(FRAMES):
            message.header["start_ns"] = 10**9 + number * 10**6
            message.records["position"] = (number / 1e3, 0, 0)
            message.records["point_on_part"] = (0, 0, 0) if number % 2 else np.nan
            message.records["signed_distance"] = number / 1e3
            frames.append(message.seal(1, number))
    return tmp_path / "run.frames"


def test_its_reader_finds_what_was_written(log, tmp_path):
    chunks = pytest.importorskip("rerun.chunk", reason="rerun-sdk of 0.41 or later reads its own recordings")
    part = ShownPart("lid", np.eye(3), np.array([[0, 1, 2]]))

    assert write_rerun(tmp_path / "run.rrd", FrameReader(log), [part]) == FRAMES

    rows = Counter()
    for chunk in chunks.RrdReader(tmp_path / "run.rrd").stream().to_chunks():
        rows[chunk.entity_path] += chunk.num_rows
    assert rows["/parts/lid"] == 1
    assert rows["/fingers/0/tip"] == rows["/fingers/0/signed_distance_mm"] == FRAMES
    assert rows["/fingers/0/nearest"] == FRAMES // 2
    assert not any(entity.startswith("/fingers/1") for entity in rows)  # it was not tracked


def test_without_it_a_sentence_says_what_to_install(log, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)

    with pytest.raises(MissingLibraryError, match=r'needs rerun-sdk.*pip install "cad-proximity\[rerun\]"$'):
        write_rerun(tmp_path / "run.rrd", FrameReader(log))
    assert not (tmp_path / "run.rrd").exists()
