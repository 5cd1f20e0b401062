"""Build a release and test it in a clean environment: ``python tools/release.py [--out FOLDER]``.

1. Build the source distribution, and from it the wheel of this machine.
2. Check both with twine, and the use of Python's stable interface with abi3audit. Write a bill of materials
   (CycloneDX): the distribution, what it requires, and what compiled it.
3. Install the wheel in an empty environment.
4. Run the Python blocks of the README there, in a folder that has only the sample parts; then the demo, which
   needs an extra.

Uploads no files. It builds the working tree: commit first.
"""

import argparse
import hashlib
import itertools
import json
import re
import shutil
import subprocess
import sys
import tempfile
import venv
import zipfile
from email.parser import Parser
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"```(python|text)\n(.*?)```", re.DOTALL)
REQUIREMENTS = ROOT / "tools" / "kernel_build" / "requirements.txt"
IMPORTED_FROM = "import proximity; print(proximity.__file__)"


class Environment:
    """A new virtual environment, whose programs do not see the checkout."""

    def __init__(self, folder: Path, *packages: str) -> None:
        venv.create(folder, with_pip=True)
        self._programs = folder / ("Scripts" if sys.platform == "win32" else "bin")
        self.run("python", "-m", "pip", "install", "--quiet", *packages)

    def run(self, program: str, *arguments: str | Path, folder: Path | None = None) -> str:
        """Run one of its programs and return its output; exit if it fails."""
        path = shutil.which(program, path=str(self._programs))
        assert path is not None, f"{program} was not installed"
        done = subprocess.run(
            [path, *map(str, arguments)], cwd=folder, text=True, stdout=subprocess.PIPE, check=False
        )
        if done.returncode:
            raise SystemExit(f"release: {program} {' '.join(map(str, arguments))} failed:\n{done.stdout}")
        return done.stdout


def main() -> None:
    """Build, check and test; the files are in the folder at the end."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="where the files go")
    out = parser.parse_args().out.resolve()
    for file in out.glob("cad_proximity-*"):  # of an earlier build
        file.unlink()
    with tempfile.TemporaryDirectory() as made:
        work = Path(made)
        files = build(work, out)
        try_wheel(work, next(file for file in files if file.suffix == ".whl"))
    print("\n".join(map(str, files)))


def build(work: Path, out: Path) -> list[Path]:
    """Return the source distribution and the wheel built from it, checked."""
    say("building and checking; compiling the kernels takes a minute or two")
    tools = Environment(work / "tools", "build", "twine", "abi3audit")
    tools.run("python", "-m", "build", "--outdir", out, ROOT)
    files = sorted(out.glob("cad_proximity-*"))
    if {file.suffix for file in files} != {".gz", ".whl"}:
        raise SystemExit(f"release: expected a wheel and an archive of sources, got {files}")
    tools.run("python", "-m", "twine", "check", "--strict", *files)
    wheel = next(file for file in files if file.suffix == ".whl")
    tools.run("python", "-m", "abi3audit", "--strict", wheel)
    bill = wheel.with_suffix(".cdx.json")
    bill.write_text(json.dumps(bill_of_materials(wheel), indent=2) + "\n", encoding="utf-8")
    return [*files, bill]


def bill_of_materials(wheel: Path) -> dict[str, Any]:
    """Return the materials of a wheel, CycloneDX 1.5: itself, its requirements and what it was compiled with.

    A requirement has the versions that are allowed; one of an extra is optional.
    """
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(name).decode("utf-8"))
    reference = f"pkg:pypi/{metadata['Name']}@{metadata['Version']}"
    required = [part_of(text) for text in metadata.get_all("Requires-Dist", [])]
    used = [part_of(text, "excluded") for text in REQUIREMENTS.read_text(encoding="ascii").split()]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": {
                "type": "library",
                "bom-ref": reference,
                "purl": reference,
                "name": metadata["Name"],
                "version": metadata["Version"],
                "licenses": [{"license": {"id": metadata["License-Expression"]}}],
                "hashes": [{"alg": "SHA-256", "content": hashlib.sha256(wheel.read_bytes()).hexdigest()}],
            }
        },
        "components": [*required, *used],
        "dependencies": [{"ref": reference, "dependsOn": sorted({part["bom-ref"] for part in required})}],
    }


def part_of(requirement: str, scope: str = "") -> dict[str, Any]:
    """Return a requirement, such as ``numpy>=2; extra == "test"``, as a component."""
    text, _, condition = requirement.partition(";")
    name, versions = re.fullmatch(r"([\w.-]+(?:\[[\w,]+\])?) *(.*)", text.strip()).groups()
    reference = f"pkg:pypi/{name.partition('[')[0].lower()}"
    scope = scope or ("optional" if "extra ==" in condition else "required")
    return {
        "type": "library",
        "bom-ref": f"{reference}#{hashlib.sha256(requirement.encode()).hexdigest()[:12]}",
        "purl": reference,
        "name": name,
        "scope": scope,
        "properties": [{"name": "requirement", "value": f"{versions};{condition}".rstrip(";")}],
    }


def try_wheel(work: Path, wheel: Path) -> None:
    """Install the wheel in an empty environment, and run the demo and the README's blocks there."""
    say(f"installing {wheel.name} in an empty environment")
    empty = Environment(work / "empty", str(wheel))
    place = work / "stranger"
    shutil.copytree(ROOT / "meshes", place / "meshes")
    imported = Path(empty.run("python", "-c", IMPORTED_FROM, folder=place).strip())
    if not imported.is_relative_to((work / "empty").resolve()):
        raise SystemExit(f"release: proximity was imported from {imported}, not from the wheel")
    for number, (code, printed) in enumerate(examples(), start=1):
        say(f"running Python block {number} of the README")
        found = empty.run("python", "-c", code, folder=place)
        if found != printed:
            raise SystemExit(f"release: block {number} of README.md printed\n{found}expected\n{printed}")
    say("running the demo")
    empty.run("python", "-m", "pip", "install", "--quiet", f"{wheel}[service]")
    empty.run("proximity", "demo", "--limit", "3", folder=place)


def examples() -> list[tuple[str, str]]:
    """Return each Python block of the README with the text block that follows it."""
    blocks = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    return [
        (text, shown)
        for (language, text), (follows, shown) in itertools.pairwise(blocks)
        if (language, follows) == ("python", "text")
    ]


def say(sentence: str) -> None:
    """Report progress."""
    print(f"release: {sentence}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
