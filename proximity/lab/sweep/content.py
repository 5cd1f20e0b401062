"""Digests of files: two files of equal content have one."""

import hashlib


def file_digest(path: str) -> str:
    """Return the SHA-256 of a file, 64 hexadecimal digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
