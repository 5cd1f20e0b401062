"""The controller in C under sanitizers, given random datagrams and samples.

``PROXIMITY_FUZZ_SECONDS=60`` sets the duration, as in ``.ci/run``; -s shows the number of inputs.
"""

import os

from compiling_c import c_compiler, run
from controller_in_c import DRIVER, SANITIZERS, SOURCES

from proximity.decaff.controller.chip_sources import write_controller
from proximity.decaff.glove.glove import Glove

SECONDS = os.environ.get("PROXIMITY_FUZZ_SECONDS", "2")


def test_whatever_comes_no_finger_is_unsafe(tmp_path):
    """Forces finite and within limits, no advance without fresh frames, no power without sensor readings."""
    write_controller([Glove()], tmp_path)
    sources = [*(tmp_path / name for name in SOURCES), DRIVER.with_name("controller_fuzzer.c")]
    run(c_compiler(), "-std=c99", *SANITIZERS, f"-I{tmp_path}", *sources, "-lm", "-o", tmp_path / "fuzzer")
    print(told := run(tmp_path / "fuzzer", SECONDS, "7"))

    samples, used, *by_state = (int(word) for word in told.split() if word.isdigit())
    assert samples == sum(by_state) and used > 1000 and min(by_state) > 100  # every state was reached
