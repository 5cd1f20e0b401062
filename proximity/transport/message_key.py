"""Keys of ``udp://…?key=FILE``, with which senders tag messages and receivers verify them.

A key is 32 random bytes, stored as 64 hexadecimal digits and a line end in a file readable by its owner only.
A tag of 16 bytes follows each message in its datagram. It is the BLAKE2s hash (RFC 7693) of the whole message
with the key.
"""

import contextlib
import hmac
import os
import secrets
import stat
from hashlib import blake2s
from typing import Any

import numpy as np

from proximity.errors import PublishError
from proximity.transport.address import Address

KEY_BYTES = 32
TAG_BYTES = 16
"""Size of a tag. A random tag is right with a probability of 1 in 3e38."""
_DIGITS = 2 * KEY_BYTES
_MAX_READ = 1024
_READ_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_WRITE_FLAGS = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


class Key:
    """A key that makes and verifies tags.

    *secret*: the key, (32,) bytes.
    """

    def __init__(self, secret: bytes) -> None:
        self.secret = np.frombuffer(secret, np.uint8)  # read by the compiled loop
        self._begun = blake2s(key=secret, digest_size=TAG_BYTES)

    def tag(self, message: Any) -> bytes:
        """Return the tag of a message."""
        hashed = self._begun.copy()
        hashed.update(message)
        return hashed.digest()

    def verifies(self, datagram: Any) -> bool:
        """Return whether a datagram is a message followed by its tag.

        The time that it takes does not depend on the contents of the tag.
        """
        end = len(datagram) - TAG_BYTES
        return end >= 0 and hmac.compare_digest(self.tag(datagram[:end]), datagram[end:])


def key_of(address: Address) -> Key | None:
    """Read the key that an address names. Return None if it names no key."""
    path = address.options.get("key")
    if path is None:
        return None
    try:
        number = os.open(path, _READ_FLAGS)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or failure
        raise address.refuse(
            f"the key {path!r} cannot be read ({reason}; `proximity client key --out FILE` makes one)"
        ) from failure
    try:
        _check_file(address, path, os.fstat(number))
        text = os.read(number, _MAX_READ)
    finally:
        os.close(number)
    digits = text.rstrip(b"\r\n")
    try:
        secret = bytes.fromhex(digits.decode("ascii"))
    except ValueError:
        secret = b""
    if len(secret) != KEY_BYTES or len(digits) != _DIGITS:
        raise address.refuse(
            f"{path!r} is not a key (expected {_DIGITS} hexadecimal digits, as `proximity client key` writes)"
        )
    return Key(secret)


def write_key(path: str) -> None:
    """Create a file with a new key that only its owner may read."""
    try:
        number = os.open(path, _WRITE_FLAGS, 0o600)
    except FileExistsError as taken:
        raise PublishError(
            f"{path}: exists already, and a key is never overwritten (expected the name of a new file)"
        ) from taken
    except (OSError, ValueError) as failure:
        raise _not_written(path, failure) from failure
    try:
        with os.fdopen(number, "wb") as stream:
            stream.write(secrets.token_hex(KEY_BYTES).encode("ascii") + b"\n")
            stream.flush()
            os.fsync(number)
    except BaseException as failure:
        with contextlib.suppress(OSError):  # remove an incomplete key
            os.unlink(path)
        if isinstance(failure, OSError):
            raise _not_written(path, failure) from failure
        raise


def _check_file(address: Address, path: str, status: os.stat_result) -> None:
    """Raise an error if the file is not a regular file or other users may read the key."""
    if not stat.S_ISREG(status.st_mode):
        raise address.refuse(f"the key {path!r} is not a regular file")
    allowed = stat.S_IMODE(status.st_mode)
    if os.name != "nt" and allowed & 0o077:
        raise address.refuse(
            f"the key {path!r} may be used by others: its permissions are {allowed:04o} "
            f"(expected 0600: chmod 600 {path})"
        )


def _not_written(path: str, failure: Exception) -> PublishError:
    return PublishError(f"{path}: cannot be written ({getattr(failure, 'strerror', None) or failure})")
