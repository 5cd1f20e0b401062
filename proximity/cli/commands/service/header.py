"""``proximity header``: the C and C++ header of the messages."""

from pathlib import Path
from typing import Annotated

import typer

HELP = "\n\n".join(
    (
        "Print decaff_message.h, the layout of all messages for C99, C11 and C++.",
        "It contains a structure for each message, with a comment for each field, and functions that check "
        "whether bytes are a frame and how far it can be trusted. It includes standard headers only: a "
        "microcontroller that receives udp:// datagrams needs nothing else.",
    )
)

EXAMPLES = """
Examples:
  proximity header --out decaff_message.h
  proximity header --receiver --out receiver.c    # the example of a receiver
"""


def command(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write to this file instead of printing.")
    ] = None,
    receiver: Annotated[
        bool, typer.Option("--receiver", help="Print the C example that receives frames over UDP instead.")
    ] = False,
) -> None:
    """Print or write the header."""
    # NumPy: only now, so that --help answers at once.
    from proximity import transport
    from proximity.message.c_header import header_text
    from proximity.system.whole_file import whole_file

    if receiver:
        text = Path(transport.__file__).with_name("receiver.c").read_text(encoding="ascii")
    else:
        text = header_text()
    if out is None:
        typer.echo(text, nl=False)
        return
    with whole_file(out) as stream:
        stream.write(text.encode("ascii"))
