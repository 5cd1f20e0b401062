"""Programs built from the clients of ``proximity client``, each with its own driver.

A driver takes commands: ``read EVENTS ANSWERS`` makes its reader process events from a file, ``tag KEY DATA
SIZE…`` prints tags, ``listen`` and ``send HOST PORT FROM-or-BIND KEY`` open an end of UDP; ``-`` omits a
value.
"""

import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from compiling_c import WARNINGS, compiler, run

from proximity.clients import write_client
from proximity.message import CONTACT, Defect, State

DRIVERS = Path(__file__).parents[1] / "clients"
DEFECTS = [None, *Defect]
LANGUAGES = ("cpp", "javascript", "csharp")
PATIENCE = 60.0


def build(language, folder, source, target):
    """Build a client's program in *folder* and return its command; skip the test without a compiler."""
    write_client(language, folder)
    if folder not in source.parents:
        shutil.copy(source, folder)
    name = source.name
    if language == "cpp":
        cxx = compiler("g++", "clang++")
        run(
            cxx,
            "-std=c++20",
            "-O1",
            *WARNINGS,
            "-Wshadow",
            "-Wconversion",
            folder / name,
            "-o",
            folder / target,
        )
        return [folder / target]
    if language == "javascript":
        return [compiler("node"), folder / name]
    options = ["-unsafe", "-optimize", "-warn:4", "-warnaserror", "-nologo"]
    sources = [folder / "Runtime" / each for each in ("ProximityMessages.cs", "ProximityClient.cs")]
    run(compiler("mcs"), *options, *sources, source, f"-out:{folder / target}.exe")
    return [compiler("mono"), folder / f"{target}.exe"]


def driver_source(language):
    return DRIVERS / {"cpp": "driver.cpp", "javascript": "driver.mjs", "csharp": "Driver.cs"}[language]


def build_driver(language, folder):
    """Return the command of a client's driver; skip the test where clients are not built."""
    if sys.platform == "win32":
        pytest.skip("clients are built and run on POSIX systems only")
    return build(language, folder, driver_source(language), "driver")


def example_source(language, folder):
    return (
        folder / {"cpp": "example.cpp", "javascript": "example.mjs", "csharp": "Runtime/Example.cs"}[language]
    )


def ask(program, *words, code=0):
    """Run a program to its end; return its output."""
    command = [str(word) for word in (*program, *words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stderr) == (code, ""), done
    return done.stdout


class Events:
    """Events for a reader: arriving frames, and requests for its state."""

    def __init__(self, shares_clock, is_keyed=False):
        self.data = bytearray([shares_clock, is_keyed])
        self.kinds = []

    def offer(self, data, now):
        self.data += struct.pack("<BqI", 1, now, len(data)) + data
        self.kinds.append("offer")

    def look(self, now):
        self.data += struct.pack("<Bq", 0, now)
        self.kinds.append("look")

    def answers(self, program, folder):
        """Return a program's answers, its counts of received, lost and sessions, and its part names."""
        (folder / "events").write_bytes(self.data)
        ask(program, "read", folder / "events", folder / "answers")
        data, at, answers = (folder / "answers").read_bytes(), 0, []
        for kind in self.kinds:
            if kind == "offer":
                answers.append(DEFECTS[data[at]])
                at += 1
                continue
            state, is_new, now_ns, age_ns, count = struct.unpack_from("<BBqqI", data, at)
            at += 22
            contacts = np.frombuffer(data, CONTACT, count, at)
            at += contacts.nbytes
            valid = np.frombuffer(data, [("is_known", "?"), ("contact", CONTACT)], count, at)
            at += valid.nbytes
            answers.append((State(state), bool(is_new), now_ns, age_ns, contacts, valid))
        names = data[at + 24 :].decode().splitlines()
        return answers, struct.unpack_from("<QQQ", data, at), names
