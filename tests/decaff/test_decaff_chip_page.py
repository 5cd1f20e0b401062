"""The firmware that docs/guide/controller.md shows is complete, and calls what is written."""

import re

from compiling_c import c_compiler, run
from controller_in_c import STRICT
from pages import PAGES

from proximity.decaff.chip.sources import write_controller
from proximity.decaff.glove.glove import Glove


def test_firmware_of_the_page_compiles(tmp_path):
    (shown,) = re.findall(r"```c\n(.*?)```", PAGES["guide/controller.md"], re.DOTALL)
    write_controller([Glove()], tmp_path)
    (tmp_path / "firmware.c").write_text(shown)

    run(c_compiler(), *STRICT, "-c", tmp_path / "firmware.c", "-o", tmp_path / "firmware.o")
