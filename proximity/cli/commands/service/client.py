"""``proximity client``: sources with which programs in C++, JavaScript and C# read frames and send poses."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

HELP = "\n\n".join(
    (
        "Write a client into a folder: sources in C++, JavaScript or C# that read frames and send poses.",
        "It verifies frames and ages them (OK, LATE, STALE) as the subscriber of proximity does, and "
        "supports the keys of udp://. cpp is header only, for C++20 on POSIX systems and Windows; "
        "javascript is ES modules for browsers and Node; csharp is for Unity and .NET. An example is "
        "written as well. An existing example is kept; the other files are replaced.",
    )
)

EXAMPLES = """
Examples:
  proximity client cpp --out decaff
  proximity client csharp --out Assets/Decaff
"""


class Language(StrEnum):
    """A language that there is a client for."""

    csharp = "csharp"
    javascript = "javascript"
    cpp = "cpp"


def command(
    language: Annotated[
        Language, typer.Argument(metavar="csharp|javascript|cpp", help="Language of your program.")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write the files to.")],
) -> None:
    """Write the files of a client."""
    # NumPy: only now, so that --help answers at once.
    from proximity.message.clients import write_client

    for path, is_written in write_client(language.value, out).items():
        typer.echo(f"{path}: {'written' if is_written else 'left alone, it is there already'}")
