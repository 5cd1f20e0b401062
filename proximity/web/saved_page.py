"""Save a page as one file with parts and engine, which needs no service, server or network."""

import base64
import gzip
import hashlib
import json
import posixpath
import re
from pathlib import Path

from proximity.system.whole_file import whole_file
from proximity.web.page_content import scene_page_files

LEVEL = 6  # level of the compression
CHARSET = "windows-1252"
"""Character set in which every byte is a letter. The text is 2 % longer than the bytes, while base64 would be
a third longer."""
POLICY = (
    """<meta http-equiv="Content-Security-Policy" content="default-src 'none'; base-uri 'none'; """
    """form-action 'none'; img-src blob: data:; style-src 'nonce-{nonce}'; """
    """script-src 'nonce-{nonce}' 'wasm-unsafe-eval' blob:">"""
)
"""Policy under which only code of the file runs and no data leave it. Code in the name of a part does not
run."""
_IMPORTED = re.compile(r"""(\bfrom\s*|\bimport\s*\(?\s*)(["'])([^"']+)\2""")
_THREE = "page/vendor/three/three.module.js"
_SCRIPTS = re.compile(r'<script type="(?:importmap|module)".*?</script>\n', re.DOTALL)
_LINK = re.compile(r'<link rel="(?:icon|stylesheet)" href="\./(\w+\.\w+)">')
BEGIN = """
window.saved = async (name) => {
  const element = document.getElementById(`saved-${name}`);
  if (!element) return null;
  const text = element.textContent, packed = new Uint8Array(text.length), byteOf = new Uint8Array(65536);
  const all = new TextDecoder("windows-1252").decode(Uint8Array.from({ length: 256 }, (_, byte) => byte));
  for (let byte = 0; byte < 256; byte++) byteOf[all.charCodeAt(byte)] = byte;
  let size = 0;
  for (let k = 0; k < text.length; k++) {
    packed[size++] = text[k] === "=" ? byteOf[text.charCodeAt(++k)] - 64 : byteOf[text.charCodeAt(k)];
  }
  const stream = new Blob([packed.subarray(0, size)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
};
const { nonce } = document.currentScript;
(async () => {
  const imports = {};
  for (const [name, text] of Object.entries(JSON.parse(new TextDecoder().decode(await saved("modules"))))) {
    imports[name] = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  }
  const map = document.createElement("script");
  map.type = "importmap";
  map.nonce = nonce;
  map.textContent = JSON.stringify({ imports });
  document.head.append(map);
  await import("page/main.js");
})().catch((failure) => {
  document.getElementById("cover-text").textContent = `This browser cannot show the page: ${failure.message}`;
});
"""
"""Code that creates modules from the contents of the file and starts the page."""


def save_page(path: Path, shown: dict[str, bytes]) -> int:
    """Write a page that contains a scene. Return its size in bytes.

    *shown*: contents from `shown_contents`.
    """
    files = scene_page_files().contents
    modules = {
        f"page{name}": _by_names(f"page{name}", content.decode())
        for name, content in files.items()
        if name.endswith((".js", ".mjs"))
    }
    packed = {
        "modules": json.dumps(modules).encode(),
        **shown,
        **{name[1:]: content for name, content in files.items() if name.endswith(".wasm")},
    }
    blocks = [
        f'<script type="application/octet-stream" id="saved-{name}">'.encode()
        + _packed(content)
        + b"</script>"
        for name, content in packed.items()
    ]
    page = _SCRIPTS.sub("", files["/index.html"].decode())
    page = _LINK.sub(lambda link: _inside(files[f"/{link[1]}"], link[1]), page)
    nonce = hashlib.sha256(b"".join(blocks)).hexdigest()
    page = page.replace('<meta charset="utf-8">', f'<meta charset="{CHARSET}">{POLICY.format(nonce=nonce)}')
    page = page.replace("<style>", f'<style nonce="{nonce}">')
    head, body, tail = page.encode("ascii", "xmlcharrefreplace").partition(b"</body>")
    content = b"\n".join([head, *blocks, f'<script nonce="{nonce}">{BEGIN}</script>'.encode(), body + tail])
    with whole_file(path) as stream:
        stream.write(content)
    return len(content)


def _by_names(module: str, text: str) -> str:
    """Return the text of a module in which the imports use the names of the page's import map."""

    def named(match: re.Match[str]) -> str:
        name = match[3]
        if name == "three":
            name = _THREE
        elif name.startswith("."):
            name = posixpath.normpath(posixpath.join(posixpath.dirname(module), name))
        return f"{match[1]}{match[2]}{name}{match[2]}"

    return _IMPORTED.sub(named, text)


def _packed(content: bytes) -> bytes:
    """Return compressed content, in which each byte is one letter of the page's character set.

    Characters that a page may not contain are escaped.
    """
    packed = gzip.compress(content, LEVEL, mtime=0)
    for letter in b"=\0\r<":
        packed = packed.replace(bytes([letter]), b"=" + bytes([letter + 64]))
    return packed


def _inside(content: bytes, name: str) -> str:
    if name.endswith(".css"):
        return f"<style>\n{content.decode()}</style>"
    return f'<link rel="icon" href="data:image/svg+xml;base64,{base64.b64encode(content).decode()}">'
