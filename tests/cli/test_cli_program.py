"""The program as a process: its imports, pipes, Ctrl-C, and completion in a shell."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from project import MESHES, SUPPORT

from proximity.message.c_header import header_text
from proximity.native import IS_AHEAD
from proximity.transport.address import parse
from proximity.transport.message_key import key_of

HEAVY = {"numba", "numpy", "scipy", "trimesh", "llvmlite", "manifold3d", "cascadio", "networkx"}

AS_PROGRAM = """
import sys
from proximity import cli
sys.argv = ["proximity", *{arguments!r}]
try:
    cli.main()
except SystemExit as end:
    code = end.code
print("imported", *sorted({heavy!r} & set(sys.modules)), file=sys.stderr)
sys.exit(code)
"""

ON_A_SPHERE = """
import sys
sys.path.insert(0, {tests!r})
import proximity
from fake_scene import FakeScene
from proximity import cli
vars(proximity).update(load=lambda path, units, **options: FakeScene(), kernels_are_cached=lambda: True)
sys.argv = ["proximity", *{arguments!r}]
{before}
cli.main()
"""


ON_POSIX = pytest.mark.skipif(os.name == "nt", reason="pipes and signals of POSIX")


def environment(**more):
    kept = {key: value for key, value in os.environ.items() if key not in ("FORCE_COLOR", "GITHUB_ACTIONS")}
    return {**kept, **more}


def run_python(*words, variables=None, **options):
    """Run Python with words of its command line, or code; stdout and stderr are pipes by default."""
    words = words if len(words) > 1 else ("-c", *words)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.run(
        [sys.executable, *words], text=True, timeout=60, env=environment(**variables or {}), **pipes
    )


def on_a_sphere(*arguments, before=""):
    """Return code of the program on an analytic sphere, with code that runs before."""
    return ON_A_SPHERE.format(tests=str(SUPPORT), arguments=list(arguments), before=before)


def started(code, stdin=None):
    """Start Python with code, its pipes in text mode."""
    return subprocess.Popen(
        [sys.executable, "-c", code], stdin=stdin, stdout=-1, stderr=-1, text=True, env=environment()
    )


COLD_QUERY_MODULES = 66
"""Maximum number of the package's modules that a query imports: without other formats and kernels."""
COUNTED = """
import sys
from proximity import cli
sys.argv = ["proximity", "query", {path!r}, "0", "0", "0"]
try:
    cli.main()
finally:
    print(*(name for name in sys.modules if name.partition(".")[0] == "proximity"), file=sys.stderr)
"""


@pytest.mark.skipif(not IS_AHEAD, reason="where kernels are compiled when called, their modules are imported")
@pytest.mark.processes
def test_a_query_imports_no_more_than_it_needs():
    found = run_python(COUNTED.format(path=str(MESHES / "bracket.stl")))
    modules = found.stderr.split()

    assert "signed distance" in found.stdout
    assert len(modules) <= COLD_QUERY_MODULES, modules
    needless = ("formats.gltf", "formats.step", "scene.saved", "tracker", "kernels.tree", "kernels.scene")
    assert not {f"proximity.{module}" for module in needless} & set(modules)


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["query", "--help"], ["watch", "--help"], ["query", "part.stl", "1", "--no"]],
    ids=" ".join,
)
def test_help_and_version_import_nothing_heavy(arguments):
    result = run_python(AS_PROGRAM.format(arguments=arguments, heavy=HEAVY))

    assert result.stderr.splitlines()[-1] == "imported"


@pytest.mark.skipif(not IS_AHEAD, reason="numba compiles the kernels")
@pytest.mark.parametrize(
    "arguments",
    [
        ["query", "bracket.stl", "30", "10", "5"],
        ["check", "bracket.stl"],
        ["compile", "bracket.stl", "--out", "{out}/bracket.prox"],
        ["simulate", "--speed", "0.5"],
        ["demo", "--limit", "0.2"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_nothing_waits_for_the_compiler(arguments, tmp_path):
    arguments = [word.format(out=tmp_path) for word in arguments]
    heavy = {"numba", "llvmlite"} | ({"pydantic"} if arguments[0] == "query" else set())
    result = run_python(AS_PROGRAM.format(arguments=arguments, heavy=heavy), cwd=MESHES)

    assert result.returncode == 0, result.stderr
    assert result.stderr.splitlines()[-1] == "imported"


def test_query_looks_for_no_garbage_while_it_starts_and_does_so_again_afterwards():
    before = """
import atexit, gc
def load(path, units, **options):
    print("while it starts:", gc.isenabled(), file=sys.stderr)
    return FakeScene()
proximity.load = load
atexit.register(lambda: print("afterwards:", gc.isenabled(), file=sys.stderr))
"""
    result = run_python(on_a_sphere("query", "ball.stl", "1", "2", "3", before=before))
    assert result.stderr == "while it starts: False\nafterwards: True\n"


def test_module_runs_as_the_program():
    result = run_python("-m", "proximity", "--version")
    assert result.returncode == 0 and result.stdout.startswith("proximity ")


def test_interrupt_while_the_program_is_imported_is_quiet():
    code = """
import sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
from proximity import __main__
__main__.main()
"""
    result = run_python(code)

    assert (result.returncode, result.stdout, result.stderr) == (130, "", "")


@ON_POSIX
@pytest.mark.parametrize("option", ["--csv=-", "--units=mm"])
def test_reader_that_stops_early_causes_no_complaint(option, tmp_path):
    points = tmp_path / "points.txt"  # a pipe would fill up: answers are written while points are read
    points.write_text("1 2 3\n" * 50_000, encoding="utf-8")
    with points.open(encoding="utf-8") as lines:
        program = started(on_a_sphere("query", "ball.stl", "--points", "-", option), lines)
    program.stdout.readline()
    program.stdout.close()

    complaint = program.stderr.read()
    program.stderr.close()
    assert program.wait(timeout=60) == 141
    assert complaint == ""


@ON_POSIX
def test_first_answers_come_while_points_are_still_written():
    program = started(on_a_sphere("query", "ball.stl", "--points", "-", "--csv", "-"), subprocess.PIPE)
    with program:
        program.stdin.write("0 0 11\n" * 20_000)
        program.stdin.flush()
        lines = [program.stdout.readline() for _ in range(20_001)]
        program.stdin.write("0 0 12\n0\n")
        program.stdin.close()
        rest, complaint = program.stdout.read(), program.stderr.read()

    assert lines[0].startswith("x_mm,") and lines[-1].startswith("0.0,0.0,11.0,1.0,")
    assert rest.startswith("0.0,0.0,12.0,2.0,") and rest.count("\n") == 1
    assert complaint == "proximity: standard input, line 20002: 1 value, expected 3\n"
    assert program.returncode == 2


@ON_POSIX
@pytest.mark.parametrize("arguments", [["check", "ball.stl"], ["--help"], ["query"]], ids=" ".join)
def test_reader_that_has_gone_before_lines_for_people_ends_as_any_other(arguments):
    # Regression: 1, the answer of `check --strict` for a part without an inside.
    reading, writing = os.pipe()
    os.close(reading)
    program = run_python(on_a_sphere(*arguments), stdout=writing)
    os.close(writing)
    assert (program.returncode, program.stderr) == (141, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a file that is always full")
@pytest.mark.parametrize(
    "arguments",
    [
        ["query", "ball.stl", "1", "2", "3"],
        ["query", "ball.stl", "--points", "-", "--csv", "-"],
        ["check", "ball.stl", "--json"],
        ["--help"],
    ],
    ids=" ".join,
)
def test_output_that_does_not_fit_the_disk_is_refused_in_one_sentence(arguments):
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        program = run_python(on_a_sphere(*arguments), input="1 2 3\n" * 50_000, stdout=full)
    assert program.stderr == "proximity: the output cannot be written (No space left on device)\n"
    assert program.returncode == 2


@pytest.mark.parametrize("option", ["--json", "--units=mm"])
def test_output_that_is_closed_is_refused_in_one_sentence(option):
    before = "sys.stdout = None"  # as in Python after >&-
    result = run_python(on_a_sphere("query", "ball.stl", "1", "2", "3", option, before=before))

    expected = "standard output is closed, expected a terminal, a file or a pipe to write to"
    assert (result.returncode, result.stderr) == (2, f"proximity: {expected}\n")


@ON_POSIX
def test_ctrl_c_ends_quietly():
    before = "import time\nproximity.load = lambda *_, **__: (print('reading', flush=True), time.sleep(60))"
    program = started(on_a_sphere("check", "a.stl", before=before))
    assert program.stdout.readline() == "reading\n"
    program.send_signal(signal.SIGINT)

    _, complaint = program.communicate(timeout=60)
    assert program.returncode == 130
    assert complaint == ""


def test_name_that_the_terminal_cannot_write_is_escaped():
    before = (
        "sys.stdout.reconfigure(encoding='ascii', errors='strict')\n"
        "proximity.load = lambda path, units, **options: FakeScene(name='Gehäuse')"
    )
    result = run_python(on_a_sphere("query", "a.stl", "0", "0", "1", before=before))
    assert result.returncode == 0 and "Geh\\xe4use" in result.stdout


def complete(words):
    """Return completions of the last word, requested as bash's script does."""
    variables = {"_PROXIMITY_COMPLETE": "complete_bash", "COMP_WORDS": " ".join(words)}
    variables["COMP_CWORD"] = str(len(words) - 1)
    return run_python("-m", "proximity", variables=variables).stdout.split()


def test_commands_options_and_units_are_completed():
    assert complete(["proximity", "q"]) == ["query"]
    assert complete(["proximity", "query", "part.stl", "-1", "--seg"]) == ["--segment"]
    assert "mm" in complete(["proximity", "query", "part.stl", "--units", "m"])


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_completion_works_in_bash(tmp_path):
    """Source the output of --show-completion, and complete as the Tab key does."""
    program = tmp_path / "proximity"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m proximity "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    script = """
        eval "$(proximity --show-completion bash)" || exit 3
        COMP_WORDS=(proximity ch) COMP_CWORD=1
        $(complete -p proximity | sed 's/.*-F \\([^ ]*\\).*/\\1/') proximity ch proximity
        echo "completed: ${COMPREPLY[*]}"
    """
    variables = {
        "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}",
        "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1",
    }
    result = subprocess.run(
        ["bash", "--norc", "-c", script], capture_output=True, text=True, timeout=60,
        env=environment(**variables),
    )  # fmt: skip
    assert result.stdout.strip() == "completed: check", result.stderr


def test_key_is_made_once(run, tmp_path):
    path = tmp_path / "poses.key"
    made, again = run("client", "key", "--out", path), run("client", "key", "--out", path)

    assert (made.code, made.err) == (0, "")
    assert made.out == f'{path}: written; use it at both ends: "udp://HOST:PORT?key={path}"\n'
    assert key_of(parse(f"udp://127.0.0.1:9100?key={path}")) is not None
    assert (again.code, again.out) == (2, "")
    assert again.err.startswith(f"proximity: {path}: exists already, and a key is never overwritten")


def test_header_is_printed_or_written(run, tmp_path):
    printed, written = (
        run("client", "header"),
        run("client", "header", "--out", tmp_path / "proximity_message.h"),
    )

    assert (printed.code, printed.out, printed.err) == (0, header_text(), "")
    assert (written.code, written.out) == (0, "")
    assert (tmp_path / "proximity_message.h").read_text(encoding="ascii") == header_text()
