"""The interface in C, compared with the recorded one: programs compiled before must run as before."""

import os
import re
from pathlib import Path

from compiling_c import c_compiler, run
from project import ROOT

from proximity.message.c_header import header_text

LIBRARY = ROOT / "proximity" / "core" / "library"
HEADERS = LIBRARY / "proximity.h", LIBRARY / "proximity_tracker.h"
RECORD = Path(__file__).with_name("c_abi.txt")
STRUCTURE = re.compile(r"typedef struct (\w+) \{(.*?)\}", re.DOTALL)
FUNCTION = re.compile(r"PROXIMITY_API ([^()]+?)(\w+)\(([^()]*)\);")
CALLBACK = re.compile(r"typedef ([\w ]+?)(\w+)\(([^()]*)\);")


def types_of(parameters):
    """Parameters without their names, which may change."""
    return ", ".join(re.sub(r"(?<=[ *])\w+$", "", each.strip()).strip() for each in parameters.split(","))


def interface(folder):
    """Functions with their types, sizes and offsets of structures, and constants: a line each, by name."""
    text = "\n".join(header.read_text(encoding="utf-8") for header in HEADERS)
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    found = {}
    for result, name, parameters in FUNCTION.findall(text) + CALLBACK.findall(text):
        found[name] = f"{' '.join(result.split())}({types_of(' '.join(parameters.split()))})"
    (folder / "proximity_message.h").write_text(header_text(), encoding="utf-8")
    values = {"proximity_contact": "sizeof(proximity_contact)"}  # what a tracker answers with
    values |= {name: name for name in re.findall(r"\b(PROXIMITY_\w+) = ", text)}
    values |= {name: name for name in re.findall(r"^#define (PROXIMITY_\w+) \(?-?\d", text, re.MULTILINE)}
    for name, body in STRUCTURE.findall(text):
        values[name] = f"sizeof({name})"
        for field in re.findall(r"(\w+)(?:\[\w+\])?(?=\s*[,;])", body):
            values[f"{name}.{field}"] = f"offsetof({name}, {field})"
    prints = "".join(f'printf("{name} %lld\\n", (long long){value});' for name, value in values.items())
    source = folder / "values.c"
    includes = "".join(f'#include "{header.name}"\n' for header in HEADERS)
    source.write_text(f"#include <stdio.h>\n{includes}int main(void) {{ {prints} return 0; }}\n")
    run(c_compiler(), f"-I{LIBRARY}", f"-I{folder}", source, "-o", folder / "values")
    return found | dict(line.split() for line in run(folder / "values").splitlines())


def test_c_interface_has_all_that_is_recorded_unchanged(tmp_path):
    """After a change that breaks programs, raise PROXIMITY_INTERFACE and record: PROXIMITY_UPDATE_TEXTS=1."""
    now = interface(tmp_path)
    if os.environ.get("PROXIMITY_UPDATE_TEXTS") == "1":
        RECORD.write_text("".join(f"{name} {now[name]}\n" for name in sorted(now)), encoding="utf-8")

    recorded = dict(line.split(" ", 1) for line in RECORD.read_text(encoding="utf-8").splitlines())

    assert len(recorded) > 100
    assert {name: now.get(name) for name in recorded} == recorded
