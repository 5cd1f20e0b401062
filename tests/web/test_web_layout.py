"""Ageing of frames on the page, in Node."""

import json
import shutil
import subprocess

import pytest

from proximity.clients import client_files
from proximity.message import FRAME, ContactFlag, Message, State
from proximity.web.page_content import PAGE

AGES = """
import fs from "node:fs";
import { Frames } from "./frames.js";
const bytes = fs.readFileSync(process.argv[2]);
const frames = new Frames();
frames.take(bytes, 0);
for (const ms of [30, 60]) frames.take(fs.readFileSync(process.argv[2] + ms), ms);
const seen = [61, 90, 140, 300].map((ms) => {
  const { state, contacts: [{ isKnown, isBound, lower, contactMs }] } = frames.at(ms);
  return [state, isKnown, isBound, lower, contactMs];
});
console.log(JSON.stringify(seen));
"""


def test_a_frame_ages_on_the_page_as_the_client_has_it(tmp_path):
    """Frames at 0, 30 and 60 ms set the clock; then none arrives."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("there is no Node here")
    shutil.copy(PAGE / "frames.js", tmp_path)
    for name, text in client_files("javascript").items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "script.js").write_text(AGES, encoding="utf-8")
    message = Message(FRAME, 1)
    record = message.records[0]
    record["flags"] = ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.IN_RANGE
    for name in (
        "signed_distance",
        "lower",
        "upper",
        "predicted_distance",
        "predicted_lower",
        "predicted_upper",
    ):
        record[name] = 0.05
    record["normal"] = (0.0, 0.0, 1.0)
    record["time_to_contact"] = record["time_to_contact_lower"] = 0.5
    for ms in (0, 30, 60):
        now = 10**9 + ms * 10**6
        for name in ("pose_ns", "start_ns", "publish_ns"):
            message.header[name] = now
        message.header["valid_until_ns"], message.header["state"] = now + 20 * 10**6, State.OK
        record["pose_ns"], record["predicted_ns"] = now, now + 10**6
        (tmp_path / f"frame{ms or ''}").write_bytes(message.seal(1, ms).tobytes())

    done = subprocess.run(
        [program, tmp_path / "script.js", tmp_path / "frame"], capture_output=True, text=True, timeout=60
    )

    assert done.returncode == 0, done.stderr
    fresh, late, later, stale = json.loads(done.stdout)
    assert fresh == ["OK", True, False, 0.05, 500.0]
    assert late[:3] == later[:3] == ["LATE", True, True]
    assert 0.05 > late[3] > later[3] and late[4] is None
    assert stale[:2] == ["STALE", False]
