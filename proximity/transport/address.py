"""Parse addresses into the transport, the location and the options."""

import os
from dataclasses import dataclass
from urllib.parse import parse_qsl, quote, unquote, urlsplit

from proximity.errors import PublishError

FILE_OPTIONS = ("key", "config")
"""Options that name a file."""


@dataclass(frozen=True, slots=True)
class Address:
    """A parsed address of the form ``scheme://location?option=value`` or ``mailbox:location``."""

    text: str
    scheme: str
    location: str
    options: dict[str, str]

    def refuse(self, expected: str) -> PublishError:
        """Return an error about the address, which ends with the text *expected*."""
        return PublishError(f"{self.text}: {expected}")

    def check_options(self, *known: str) -> None:
        """Raise an error if the address has an option that is not in *known*."""
        for name in self.options:
            if name not in known:
                has = f"expected {', '.join(known)}" if known else "it has none"
                raise self.refuse(f"unknown option {name!r} ({has})")

    def with_files_in(self, folder: str) -> str:
        """Return the text of the address in which the paths of options are joined to *folder*."""
        files = [name for name in FILE_OPTIONS if self.options.get(name)]
        if not files:
            return self.text
        options = {
            name: os.path.join(folder, value) if name in files else value
            for name, value in self.options.items()
        }
        begin = self.text.partition("?")[0]
        return f"{begin}?" + "&".join(f"{name}={quote(value, '/:[],')}" for name, value in options.items())


def parse(text: str) -> Address:
    """Parse an address."""
    if not isinstance(text, str):
        raise PublishError(f"an address is text such as shm://proximity, not {text!r}")
    try:
        parts = urlsplit(text)
        pairs = parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
    except ValueError as unfit:
        raise PublishError(f"{text}: expected scheme://location?option=value ({unfit})") from unfit
    location = unquote(parts.netloc + parts.path)
    if not parts.scheme or not location or parts.fragment:
        raise PublishError(
            f"{text}: expected an address such as shm://NAME, udp://HOST:PORT, zenoh://KEY or mailbox:NAME"
        )
    options = dict(pairs)
    if len(options) < len(pairs):
        raise PublishError(f"{text}: an option is given twice, expected each once")
    return Address(text, parts.scheme, location, options)
