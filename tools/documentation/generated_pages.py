"""Pages of the reference, generated from the program with each build of the documentation.

MkDocs calls the functions named ``on_…``: tools/documentation/mkdocs.yml names this file.
"""

import json
import re
import sys
import tempfile
import textwrap
from pathlib import Path

import typer
from typer.cli import get_docs_for_click

sys.path.insert(0, str(Path(__file__).parent))
import message_tables
import scene_file_keys
from mkdocs.structure.files import File

import proximity
from proximity import cli
from proximity.web.page_process import PageSettings, write_page

PUBLIC = {
    "Loading": ("load", "from_mesh", "from_trimesh", "to_trimesh", "LoadReport"),
    "Scenes and parts": ("Scene", "Part", "Solid", "TriangleMesh", "Pose", "SignMethod", "Surface"),
    "Answers": (
        "ClosestPoints", "RayHits", "RayCrossings", "SegmentHits", "Feature", "Clearance", "Relation",
        "Motion", "MotionClearance", "Gap", "Thickness", "ThinWalls", "overlap", "Overlap", "NO_FACE",
        "NO_PART",
    ),
    "Requirements": ("verify", "Verification", "VerifiedRequirement", "VerifiedPair", "Verdict"),
    "Tracker": (
        "Tracker", "ContactFlag", "PartTracker", "ConnectionFlag", "CONNECTION", "warm_up",
        "kernels_are_cached",
    ),
    "Service": ("serve", "start_service", "RunningService", "view", "RunningPage"),
    "Messages": (
        "open_subscriber", "Subscriber", "Reading", "State", "Source", "Mode", "PartAction", "open_publisher",
        "Publisher", "Message", "CONTACT", "FRAME", "POSES", "PATH_POSES", "GLOVE_POSES", "MOVES", "MEASURED",
        "CHANGES", "ADDITIONS", "DEFORMATIONS",
    ),
    "Errors": (
        "ProximityError", "MeshError", "MeshFormatError", "FileVersionError",
        "NotWatertightError", "ArgumentError", "PoseError",
        "FileError", "MissingLibraryError", "SceneError", "ServiceError", "PublishError",
        "RecordingError", "DecaffError", "MotorError", "UnitsWarning",
    ),
}  # fmt: skip
"""All public names, in the order of the page."""

EXAMPLES = Path(__file__).parents[2] / "examples"
CHARTS = Path(__file__).parents[2] / "docs" / "performance"
PROGRAM = re.compile(r"^The program: \[.*\]\(\.\./examples/(.*)\)$", re.MULTILINE)
"""A link for code hosts; a built page includes the program itself."""
LANGUAGES = {".py": "py", ".ipynb": "py", ".c": "c", ".h": "c", ".toml": "toml"}

STATES = {
    "State of a frame": "state",
    "Flags of a contact": "flag",
    "Mode of the drum": "mode",
    "Source of the distances": "source",
    "Kind of a surface": "surface",
    "What a change does to a part": "part_action",
}


PART = Path(__file__).parents[2] / "meshes" / "bracket.stl"
RUNNING = "running/bracket.html"
BUTTONS = "[Install](start/install.md)\n"
"""On the first page, a link to the live page follows this one."""
CHART = re.compile(r'<img alt="[^"]*" src="(?:\.\./)*(?:\w+/)*(times\w*\.svg)" ?/?>')


def on_files(files, config):
    """Add the generated pages to those of the folder, and the live page."""
    for name, text in pages().items():
        files.append(File.generated(config, f"reference/{name}", content=text))
    with tempfile.TemporaryDirectory() as folder:
        write_page(PageSettings((str(PART),)), Path(folder, "page.html"))
        files.append(File.generated(config, RUNNING, content=Path(folder, "page.html").read_bytes()))
    return files


def on_page_markdown(markdown, page, **_):
    """Append layouts to the page on messages, programs to that on examples, and a link to the first."""
    if page.file.src_uri == "index.md":
        page.meta["hide"] = ["navigation", "toc"]
        assert BUTTONS in markdown, "the first page has a link to the installation"
        return markdown.replace(BUTTONS, f"{BUTTONS}[Try it here]({RUNNING})\n")
    if page.file.src_uri == "reference/messages.md":
        return f"{markdown}\n{message_tables.records()}"
    return PROGRAM.sub(lambda link: _program(link[1]), markdown)


def on_page_content(html, **_):
    """Include charts, so that they have the colours of the page."""
    return CHART.sub(lambda image: (CHARTS / image[1]).read_text(encoding="utf-8"), html)


def _program(name):
    """Return an example as a collapsible block; for a notebook its code."""
    code = (EXAMPLES / name).read_text(encoding="utf-8")
    if name.endswith(".ipynb"):
        cells = json.loads(code)["cells"]
        code = "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    block = textwrap.indent(f"```{LANGUAGES[Path(name).suffix]}\n{code.rstrip()}\n```", "    ")
    return f'??? example "{name}"\n\n{block}'


def pages():
    """Return the generated pages of the reference, by name."""
    return {
        "command-line.md": _command_line(),
        "python.md": _python(),
        "scene-file.md": scene_file_keys.page(),
        "states.md": _states(),
    }


def _command_line():
    """Return every command with its arguments, options and examples, from ``--help``."""
    command = typer.main.get_command(cli.app)
    context = typer.Context(command, info_name="proximity")
    text = get_docs_for_click(obj=command, ctx=context, name="proximity").partition("\n")[2]
    for name, each in command.commands.items():
        summary = (each.help or "").partition("\n")[0]
        text = re.sub(
            rf"(?m)^\* `{name}`: .*$", lambda _, name=name, summary=summary: f"* `{name}`: {summary}", text
        )
    head = "# Command line\n\nWhat `proximity COMMAND --help` says, on one page.\n\n"
    return head + _examples_as_blocks(text)


def _examples_as_blocks(text):
    """Format the examples of each command as a block of shell commands."""
    lines, inside = [], False
    for line in text.split("\n"):
        if line == "Examples:":
            lines += ["**Examples**:", "", "```sh"]
            inside = True
        elif inside and not line.strip():
            lines += ["```", ""]
            inside = False
        else:
            lines.append(line.removeprefix("  ") if inside else line)
    return "\n".join([*lines, "```"] if inside else lines)


def _python():
    names = [name for group in PUBLIC.values() for name in group]
    missing = sorted({*proximity.__all__} ^ {*names})
    if missing:
        raise ValueError(f"generated_pages.PUBLIC and proximity.__all__ differ in {', '.join(missing)}")
    blocks = [
        "# Python",
        "The public names of `proximity`. Lengths are metres, instants nanoseconds.",
    ]
    for title, group in PUBLIC.items():
        blocks.append(f"## {title}")
        blocks += [
            f"::: {proximity._MODULE_OF[name]}.{name}\n    options:\n      heading: proximity.{name}"
            for name in group
        ]
    return "\n\n".join(blocks) + "\n"


def _states():
    blocks = [
        "# States and flags",
        "Their numbers are in [messages](messages.md); these are their names in Python.",
    ]
    for title, name in STATES.items():
        python_name = message_tables.ENUMS[name].__name__
        blocks += [f"## {title}", f"`proximity.{python_name}`", message_tables.enum_table(name)]
    return "\n\n".join(blocks) + "\n"
