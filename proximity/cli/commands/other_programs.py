"""``proximity header`` and ``proximity key``: what programs at the other end of a service need."""

from pathlib import Path
from typing import Annotated

import typer

HEADER_HELP = "\n\n".join(
    (
        "Print decaff_message.h, the layout of all messages for C99, C11 and C++.",
        "It holds structures with a comment for each field, what tells whether bytes are a frame, and how "
        "far a frame can be trusted. It includes standard headers only: a microcontroller that receives "
        "datagrams from udp:// needs nothing else.",
    )
)

HEADER_EXAMPLES = """
Examples:
  proximity header --out decaff_message.h
  proximity header --receiver --out receiver.c    # the example of a receiver
"""


def header(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write it there instead of printing it.")
    ] = None,
    receiver: Annotated[
        bool, typer.Option("--receiver", help="The example in C that receives frames over UDP, instead.")
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


KEY_HELP = "\n\n".join(
    (
        "Make a key for udp://HOST:PORT?key=FILE: without one, any program that reaches the port is "
        "believed.",
        "Both ends name the same file. The sender puts a tag behind each message; the receiver leaves out "
        "and counts what the key does not verify, and what it has had before. The file holds 64 hexadecimal "
        "digits (32 random bytes), may be read by its owner only, and is never written over. Use one key "
        "for each address, and copy it where nobody else reads it, with scp -p for example.",
    )
)

KEY_EXAMPLES = """
Examples:
  proximity key --out poses.key
  proximity watch "udp://127.0.0.1:9100?key=frames.key"
"""


def key(
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The file to make; must not be there.")],
) -> None:
    """Write a new key."""
    from proximity.transport.key import write_key

    write_key(str(out))
    typer.echo(f'{out}: made; name it at both ends: "udp://HOST:PORT?key={out}"')
