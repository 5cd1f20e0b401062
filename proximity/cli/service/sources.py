"""Commands that write sources for clients, the layout of messages, and keys."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from proximity.cli.options import (
    CABLE,
    GEAR,
    GLOVES,
    cable_stiffness,
    designed,
    option,
    within,
)
from proximity.cli.program import group_of

MIN_RATE_HZ, MAX_RATE_HZ = 150.0, 20000.0  # slower, each sample would trip the watchdog of 10 ms


FOLDER = Annotated[Path, option("DIR", "Folder to write the files to.", "--out")]


def c(out: FOLDER) -> None:
    """Write the engine for C and C++: shared and static library, headers, CMake package, examples.

    Examples:
      proximity library c --out engine
    """
    from proximity.clients.c_package import write_library

    _report(write_library(out))


def wasm(out: FOLDER) -> None:
    """Write the engine for browsers and Node: WebAssembly, an ES module with types, an example.

    Examples:
      proximity library wasm --out site/engine
    """
    from proximity.clients.wasm_package import BUILD, MODULES, write_package

    written = write_package(out)
    _report(written)
    if str(out / MODULES[0]) not in written:
        typer.echo(
            f"note: {MODULES[0]} is not compiled here, so browsers without relaxed vector instructions, and "
            f"Node before 21, cannot load the engine; `{BUILD}` in a checkout compiles it",
            err=True,
        )


def csharp(out: FOLDER) -> None:
    """Write the engine for Unity and .NET, as a package: its binding in C#, the library, a component.

    Examples:
      proximity library csharp --out Packages/org.cad-proximity.unity
    """
    from proximity.clients.c_package import write_csharp_library

    _report(write_csharp_library(out))


def _client_of(name: str, language: str, text: str) -> Callable[[Path], None]:
    def command(out: FOLDER) -> None:
        from proximity.clients import write_client

        _report(write_client(language, out))

    command.__name__ = name
    command.__doc__ = f"{text}\n\nExamples:\n  proximity client {name} --out client"
    return command


def _report(written: dict[Any, bool]) -> None:
    """Print the paths of the written files, and of existing examples that were kept."""
    for path, is_written in written.items():
        typer.echo(f"{path}: {'written' if is_written else 'kept, as it exists already'}")


def controller(
    out: FOLDER,
    glove: GLOVES = None,
    drum: GEAR = None,
    rate: Annotated[
        float,
        option("HZ", "Rate of controller and servo.", callback=within(MIN_RATE_HZ, MAX_RATE_HZ, "Hz")),
    ] = 3000.0,
    cable: CABLE = None,
) -> None:
    """Write the controller of a contact drum as C99 sources for a microcontroller.

    It receives frames from udp://, with or without a key, and sets the position of each drum at a fixed
    rate. States, limits, safe behaviour and servo are those of the controller in proximity drum. It
    needs no heap, only sqrt from <math.h>, and a processor with double precision, such as a Cortex-M7.
    With --glove, decaff_glove.c contains the finger paths of your glove, and the measured constants of
    its motor, gear and lever: run this command again after each calibration. With --cable the drum
    compensates the stretch of the cable while it holds a position, by the measured force or else by
    that of the motor.

    Examples:
      proximity controller --out firmware
      proximity controller --out firmware --glove glove.json
      proximity controller --out firmware --glove glove.json --cable glove.json
    """
    from proximity.decaff.controller.chip_sources import write_controller
    from proximity.decaff.controller.settings import CableRule, ControllerSettings
    from proximity.decaff.glove.calibrated_glove import read_any_glove
    from proximity.decaff.glove.glove import Glove, with_gear

    gloves = [read_any_glove(path) for path in glove or ()] or [Glove()]
    first = designed(gloves[0])
    tip_drum = (first if drum is None else with_gear(first, drum)).tip_drum()
    rule = CableRule() if cable is None else CableRule(cable_stiffness(cable))
    for path in write_controller(gloves, out, ControllerSettings(rate, tip_drum, cable=rule)):
        typer.echo(f"{path}: written")


def header(
    out: Annotated[Path | None, option("FILE", "Write to this file instead of printing.")] = None,
) -> None:
    """Print proximity_message.h, the layout of all messages for C99, C11 and C++.

    It contains a structure for each message, with a comment for each field, and functions that verify
    a frame and return its validity. It includes standard headers only, and is sufficient for a
    microcontroller that receives udp:// datagrams.

    Examples:
      proximity client header --out proximity_message.h
    """
    from proximity.message.c_header import header_text
    from proximity.system.whole_file import whole_file

    text = header_text()
    if out is None:
        typer.echo(text, nl=False)
        return
    with whole_file(out) as stream:
        stream.write(text.encode("ascii"))


def key(out: Annotated[Path, option("FILE", "File to create; must not exist.")]) -> None:
    """Create a key for udp://HOST:PORT?key=FILE. Without a key, messages of any program are accepted.

    Both ends use the same file. The sender appends a tag to each message; the receiver drops and
    counts messages that the key does not verify, and repeated ones. The file contains 64 hexadecimal
    digits (32 random bytes), is readable by its owner only, and is never overwritten. Use one key for
    each address, and copy it privately, for example with scp -p.

    Examples:
      proximity client key --out poses.key
      proximity watch "udp://127.0.0.1:9100?key=frames.key"
    """
    from proximity.transport.message_key import write_key

    write_key(str(out))
    typer.echo(f'{out}: written; use it at both ends: "udp://HOST:PORT?key={out}"')


CLIENTS = {
    "c": ("c", "Write receivers of frames in C99, over UDP and in shared memory, to start from."),
    "cpp": ("cpp", "Write the client for C++20, header only, for POSIX systems and Windows."),
    "csharp": ("csharp", "Write the client for Unity and .NET, as a package that the engine may share."),
    "js": ("javascript", "Write the client as ES modules, for browsers and Node."),
}
"""Programming languages by the names of their commands."""

library = group_of(
    "library",
    "Write the engine as a library for your own process: for scenes that `proximity compile` writes, without "
    "Python and without a service. To read the frames of a service instead: proximity client.",
    *(c, csharp, wasm),
)
client = group_of(
    "client",
    "Write a client of a service for your own program: it reads frames and sends poses, moves and changes. "
    "It verifies frames and reports their age (OK, LATE, STALE), as Python's subscriber does, and supports "
    "the keys of udp://. The engine itself, for your own process: proximity library.",
    *(_client_of(name, *about) for name, about in CLIENTS.items()),
    *(header, key),
    bare=("header",),
)
