"""``proximity key``: make a key that authenticates messages of a ``udp://`` address."""

from pathlib import Path
from typing import Annotated

import typer

HELP = "\n\n".join(
    (
        "Make a key for udp://HOST:PORT?key=FILE. Without a key, messages of any program are accepted.",
        "Both ends name the same file. The sender appends a tag to each message; the receiver discards and "
        "counts messages that the key does not verify, and repeated ones. The file holds 64 hexadecimal "
        "digits (32 random bytes), may be read by its owner only, and is never written over. Use one key "
        "for each address, and copy it where nobody else reads it, with scp -p for example.",
    )
)

EXAMPLES = """
Examples:
  proximity key --out poses.key
  proximity watch "udp://127.0.0.1:9100?key=frames.key"
"""


def command(
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="File to create; must not exist.")],
) -> None:
    """Write a new key."""
    from proximity.transport.message_key import write_key

    write_key(str(out))
    typer.echo(f'{out}: made; name it at both ends: "udp://HOST:PORT?key={out}"')
