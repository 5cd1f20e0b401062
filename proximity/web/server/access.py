"""Access control by host, origin and token, and limits on the messages of a page.

A page on any web site can make a browser connect to this machine, and can point its own name at this
machine's address (DNS rebinding). So the name in the address must be one that was printed, a connection must
come from the page that was served here, and its first message must contain the token of the printed address.
"""

import atexit
import hmac
import html
import secrets
import shutil
import tempfile
import time
import webbrowser
from dataclasses import dataclass, field
from pathlib import Path

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
MAX_BYTES = 65_536
"""Maximum size of a message. Poses of 10 fingers with their paths are 16 kB."""
MESSAGES_PER_S = 1_000.0
BYTES_PER_S = 8e6
BURST_S = 1.0
"""Time for which an unused allowance accumulates."""
HELLO_S = 30.0
"""Maximum time until a page sends its token."""

WRONG_TOKEN, UNFIT, TOO_MUCH, HELD_UP = 4403, 4400, 4429, 4408
"""Codes with which connections are closed, one for each reason."""
_REDIRECT = '<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={url}">\n'


class UnfitError(Exception):
    """Raised for an invalid message of a page. The text gives the reason."""


def new_token() -> str:
    """Return an unpredictable token."""
    return secrets.token_urlsafe(24)


@dataclass(frozen=True, slots=True)
class Access:
    """Requirements that a request must meet."""

    tokens: tuple[str, ...]
    hosts: frozenset[str]  # "name:port", in lower case
    scheme: str = "http"

    @classmethod
    def of(cls, tokens: tuple[str, ...], names: tuple[str, ...], port: int, *, is_secure: bool) -> "Access":
        """Return the requirements for a server that this machine offers under the given names."""
        usual = 443 if is_secure else 80
        hosts = {f"{name.lower()}:{port}" for name in names}
        hosts |= {name.lower() for name in names if port == usual}
        return cls(tokens, frozenset(hosts), "https" if is_secure else "http")

    def refusal(self, host: str | None, origin: str | None, *, is_live: bool) -> tuple[int, str] | None:
        """Return status and sentence of the refusal of a request, or None if it is accepted.

        *is_live*: whether it requests the live connection, which must send its origin.
        """
        if host is None or host.lower() not in self.hosts:
            return 421, "The page is not served under this name: open the address that was printed."
        expected = f"{self.scheme}://{host.lower()}"
        if origin is None:
            return (403, "A live connection must send its origin.") if is_live else None
        if origin.lower() != expected:
            return 403, "Connections from other pages are refused."
        return None

    def token_of(self, given: object) -> str | None:
        """Return the token that matches *given*, or None.

        The comparison takes constant time for tokens of one length.
        """
        if not isinstance(given, str):
            return None
        fitting = [token for token in self.tokens if hmac.compare_digest(given.encode(), token.encode())]
        return fitting[0] if fitting else None


@dataclass(slots=True)
class Allowance:
    """Number and size of messages that a page may still send."""

    messages: float = MESSAGES_PER_S * BURST_S
    size: float = BYTES_PER_S * BURST_S
    since: float = field(default_factory=time.monotonic)

    def allows(self, size: int, now: float | None = None) -> bool:
        """Count a message, and return whether it is within the allowance.

        *now*: instant on a monotonic clock, by default the present.
        """
        now = time.monotonic() if now is None else now
        elapsed, self.since = now - self.since, now
        self.messages = min(self.messages + elapsed * MESSAGES_PER_S, MESSAGES_PER_S * BURST_S) - 1.0
        self.size = min(self.size + elapsed * BYTES_PER_S, BYTES_PER_S * BURST_S) - size
        return self.messages >= 0.0 and self.size >= 0.0


def open_in_browser(url: str) -> None:
    """Open a URL in the browser without passing it as an argument.

    Every user of the machine may see the arguments of the browser. So it opens a file that redirects to the
    URL. Only this user can read the file, which is removed when this process ends.
    """
    folder = tempfile.mkdtemp(prefix="proximity-open-")  # mode 0700
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    redirect = Path(folder, "open.html")
    redirect.touch(0o600)
    redirect.write_text(_REDIRECT.format(url=html.escape(url)), encoding="utf-8")
    webbrowser.open(redirect.as_uri())
