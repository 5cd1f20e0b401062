"""The page on the keys of a scene file, made of the commented sample ``meshes/demo.toml``.

The sample shows every key of the reader; a missing key on either side is an error.
"""

import re
from pathlib import Path

from proximity.service.config import scene_file_reader

SAMPLE = Path(__file__).parents[2] / "meshes" / "demo.toml"
KEYS = {table: keys for table, keys in scene_file_reader.KEYS.items() if table != "held"}
PURPOSES = {
    "service": "How often the service answers, and where it publishes.",
    "fingers": "The fingertips that are followed.",
    "parts": "A file of one part or several. Repeat the table for every file.",
    "input": "Where poses come from: exactly one of `recording`, `poses` and `sensor`.",
    "glove": "The calibration of the glove that is worn. Requires `input.poses`.",
    "web": "The page of the service, with `proximity serve --web`.",
}
HEAD = """# Scene file

A scene file says what `proximity serve` does. It is TOML; all values are in SI units unless the name of the
key says otherwise, and files are found relative to it. An unknown key or an unusable value is
refused with its line. [`meshes/demo.toml`](../guide/service.md) is a complete one.
"""


def page():
    """Return the page as Markdown."""
    found = _keys_of_the_sample()
    blocks = [HEAD]
    for table, keys in KEYS.items():
        if {*keys} != {*found[table]}:
            raise ValueError(f"[{table}] of {SAMPLE.name} lacks or adds {sorted({*keys} ^ {*found[table]})}")
        header = f"[[{table}]]" if table == "parts" else f"[{table}]"
        rows = [f"| `{key}` | `{value}` | {meaning} |" for key, (value, meaning) in found[table].items()]
        blocks += [
            f"## `{header}`",
            PURPOSES[table],
            "\n".join(["| key | as in | meaning |", "|---|---|---|", *rows]),
        ]
    return "\n\n".join(blocks) + "\n"


def _keys_of_the_sample():
    """Return value and meaning of each key, by tables."""
    tables, keys, last = {}, {}, None
    for line in SAMPLE.read_text(encoding="utf-8").splitlines():
        if header := re.fullmatch(r"#?\[+(\w+)\]+.*", line):
            keys = tables.setdefault(header[1], {})
        elif entry := re.fullmatch(r"#?(\w+) = (.*?)\s*# (.*)", line):
            last = entry[1]
            keys[last] = (entry[2], entry[3])
        elif last and (more := re.fullmatch(r" {20,}# (.*)", line)):
            keys[last] = (keys[last][0], f"{keys[last][1]} {more[1]}")
    return tables
