"""The firmware in docs/guide/controller.md is complete and calls the functions as written."""

import re
import subprocess

from compiling_c import c_compiler, run
from controller_in_c import STRICT
from pages import PAGES

from proximity.decaff.controller.chip_sources import write_controller
from proximity.decaff.glove.glove import Glove


def test_firmware_of_the_page_compiles(tmp_path):
    (shown,) = re.findall(r"```c\n(.*?)```", PAGES["guide/controller.md"], re.DOTALL)
    write_controller([Glove()], tmp_path)
    (tmp_path / "firmware.c").write_text(shown)

    run(c_compiler(), *STRICT, "-c", tmp_path / "firmware.c", "-o", tmp_path / "firmware.o")


def test_command_of_the_page_compiles_and_links_a_program(tmp_path):
    """Functions that the page only declares are stubs here."""
    page = PAGES["guide/controller.md"]
    (shown,) = re.findall(r"```c\n(.*?)```", page, re.DOTALL)
    (command,) = re.findall(r"^cc (.*)$", page, re.MULTILINE)
    write_controller([Glove()], tmp_path / "firmware")
    own = (
        "int64_t clock_ns(void) { return 1; }\n"
        "double bend_of_potentiometer(void) { return 0.0; }\n"
        "double angle_of_encoder(void) { return 0.0; }\n"
        "bool encoder_is_at_index(void) { return false; }\n"
        "bool motor_has_fault(void) { return false; }\n"
        "void set_motor_mode(enum decaff_drive_mode mode) { (void)mode; }\n"
        "void restart_watchdog(void) {}\n"
        "void set_motor_torque(double torque) { (void)torque; }\n"
        "int main(void) { begin(); on_sample(); return 0; }\n"
    )
    (tmp_path / "your.c").write_text(shown + own)
    subprocess.run(f"{c_compiler()} {command}", shell=True, cwd=tmp_path, check=True)

    assert subprocess.run([tmp_path / "a.out"], check=False).returncode == 0
