"""A page in one file: parts, engine and page together, which needs no service, no server and no network."""

import base64
import gzip
import json
import posixpath
import re
import tempfile
from pathlib import Path
from typing import Any

from proximity.bindings.wasm_package import package_files
from proximity.scene.scene import Scene
from proximity.system.whole_file import whole_file
from proximity.web.page_content import scene_page_files

LEVEL = 6  # of the compression
_IMPORTED = re.compile(r"""(\bfrom\s*|\bimport\s*\(?\s*)(["'])([^"']+)\2""")
_THREE = "page/vendor/three/three.module.js"
_SCRIPTS = re.compile(r'<script type="(?:importmap|module)".*?</script>\n', re.DOTALL)
_LINK = re.compile(r'<link rel="(?:icon|stylesheet)" href="\./(\w+\.\w+)">')
BEGIN = """
(async () => {
  const bytesOf = async (name) => {
    const text = atob(document.getElementById(name).textContent);
    const packed = Uint8Array.from(text, (character) => character.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  };
  const textOf = async (name) => JSON.parse(new TextDecoder().decode(await bytesOf(name)));
  const imports = {};
  for (const [name, text] of Object.entries(await textOf("saved-modules"))) {
    imports[name] = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  }
  const map = document.createElement("script");
  map.type = "importmap";
  map.textContent = JSON.stringify({ imports });
  document.head.append(map);
  const { hasRelaxed } = await import("page/proximity.mjs");
  window.saved = {
    welcome: await textOf("saved-welcome"),
    scene: await bytesOf("saved-scene"),
    geometry: await bytesOf("saved-geometry"),
    engine: await bytesOf(hasRelaxed() ? "saved-relaxed" : "saved-plain"),
  };
  await import("page/main.js");
})().catch((failure) => {
  document.getElementById("cover-text").textContent = `This browser cannot show the page: ${failure.message}`;
});
"""
"""Makes modules of what the file has, and starts the page."""


def save_page(path: Path, scene: Scene, geometry: bytes, welcome: dict[str, Any]) -> int:
    """Write a page that has a scene in it; its size in bytes.

    *geometry*: of the scene, GLB. *welcome*: what a bridge would say to a page that connects.
    """
    engine = package_files()
    files = scene_page_files().contents
    modules = {
        f"page{name}": _by_names(f"page{name}", content.decode())
        for name, content in files.items()
        if name.endswith((".js", ".mjs"))
    }
    modules["page/proximity.mjs"] = _by_names("page/proximity.mjs", str(engine["proximity.mjs"]))
    with tempfile.TemporaryDirectory(prefix="proximity_page_") as folder:
        compiled = Path(folder, "scene.prox")
        scene.save(compiled)
        packed = {
            "saved-modules": json.dumps(modules).encode(),
            "saved-welcome": json.dumps(welcome).encode(),
            "saved-scene": compiled.read_bytes(),
            "saved-geometry": geometry,
            "saved-relaxed": engine["proximity.relaxed.wasm"],
            "saved-plain": engine["proximity.plain.wasm"],
        }
    blocks = [
        f'<script type="application/octet-stream" id="{name}">{_packed(content)}</script>'
        for name, content in packed.items()
    ]
    page = _SCRIPTS.sub("", files["/index.html"].decode())
    page = _LINK.sub(lambda link: _inside(files[f"/{link[1]}"], link[1]), page)
    page = page.replace("</body>", "\n".join([*blocks, f"<script>{BEGIN}</script>", "</body>"]))
    content = page.encode()
    with whole_file(path) as stream:
        stream.write(content)
    return len(content)


def _by_names(module: str, text: str) -> str:
    """The text of a module, which imports others by their names in the page's import map."""

    def named(match: re.Match[str]) -> str:
        name = match[3]
        if name == "three":
            name = _THREE
        elif name.startswith("."):
            name = posixpath.normpath(posixpath.join(posixpath.dirname(module), name))
        return f"{match[1]}{match[2]}{name}{match[2]}"

    return _IMPORTED.sub(named, text)


def _packed(content: str | bytes) -> str:
    content = content.encode() if isinstance(content, str) else content
    return base64.b64encode(gzip.compress(content, LEVEL, mtime=0)).decode()


def _inside(content: bytes, name: str) -> str:
    if name.endswith(".css"):
        return f"<style>\n{content.decode()}</style>"
    return f'<link rel="icon" href="data:image/svg+xml;base64,{base64.b64encode(content).decode()}">'
