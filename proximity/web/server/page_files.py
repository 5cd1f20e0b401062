"""Files of pages, and the headers that restrict the browser.

Only files present at the start are served, by their exact names; no part of a request becomes a path.
"""

import base64
import gzip
import hashlib
import re
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".wasm": "application/wasm",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
LEVEL = 6  # compression level: takes 0.1 s for all files, once
_IMPORT_MAP = re.compile(r'<script type="importmap">(.*?)</script>', re.DOTALL)


class PageFiles:
    """Files that are served over HTTP.

    *made*: contents that are not in the folder, by names that begin with a slash. Files of unknown types are
    omitted. *frame_ancestors*: sources of pages that may show this one in a frame, as in a content security
    policy.
    """

    def __init__(
        self, folder: Path, made: Mapping[str, str | bytes], frame_ancestors: str = "'self'"
    ) -> None:
        self._frame_ancestors = frame_ancestors
        self._known: dict[str, tuple[str, bytes]] = {}
        for path in sorted(folder.rglob("*")):
            if path.suffix in TYPES:
                name = "/" + path.relative_to(folder).as_posix()
                self._known[name] = TYPES[path.suffix], path.read_bytes()
        for name, made_content in made.items():
            if (suffix := Path(name).suffix) in TYPES:
                content = made_content.encode() if isinstance(made_content, str) else made_content
                self._known[name] = TYPES[suffix], content
        self._known["/"] = self._known["/index.html"]
        self._packed: dict[str, bytes] = {}

    @property
    def contents(self) -> dict[str, bytes]:
        """Contents of the files by their names, which begin with a slash."""
        return {name: content for name, (_, content) in self._known.items()}

    def get(self, path: str) -> tuple[str, bytes] | None:
        """Return the type and the compressed content of a file, or None if it is missing."""
        found = self._known.get(path.partition("?")[0])
        if found is None:
            return None
        kind, content = found
        key = path.partition("?")[0]
        if key not in self._packed:
            self._packed[key] = gzip.compress(content, LEVEL, mtime=0)
        return kind, self._packed[key]

    @cached_property
    def headers(self) -> dict[str, str]:
        """Headers of every response."""
        text = self._known["/"][1].decode()
        maps = [
            base64.b64encode(hashlib.sha256(each.encode()).digest()) for each in _IMPORT_MAP.findall(text)
        ]
        compiles = ["'wasm-unsafe-eval'"] if any(name.endswith(".wasm") for name in self._known) else []
        scripts = " ".join(["'self'", *compiles, *(f"'sha256-{each.decode()}'" for each in maps)])
        policy = {
            "default-src": "'none'",
            "script-src": scripts,
            "style-src": "'self'",
            "img-src": "'self' blob: data:",
            "connect-src": "'self'",
            "base-uri": "'none'",
            "form-action": "'none'",
            "frame-ancestors": self._frame_ancestors,
        }
        return {
            "Content-Security-Policy": "; ".join(f"{name} {value}" for name, value in policy.items()),
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Embedder-Policy": "require-corp",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Permissions-Policy": "xr-spatial-tracking=(self), camera=(), microphone=(), geolocation=()",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-cache",
        }
