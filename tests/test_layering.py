"""The picture of the layers, held against the imports."""

import ast
from pathlib import Path

import pytest

import proximity

PACKAGE = Path(proximity.__file__).parent

# Top to bottom. A unit (a module, or a folder) may import only from lines below its own.
LAYERS = """
cli
certificate
serving
decaff
service · scene_file
warmup · stopping
trimesh_scene
loading
replay
tracker · transport · recording
scene · message
compiled
compiled_model · compiled_fields
deforming · part
solid
moves
moving
queries · sign
batches · query_arguments
model · results · diagnosis · bodies · meshio
top · occupancy
part_arrays · archive
topology · bvh
mesh · pose
kernels
arrays · aligned · whole_file · regular_file
simd · errors · locks · collector
"""
LEVEL = {
    unit: level
    for level, line in enumerate(reversed(LAYERS.split("\n")[1:-1]))
    for unit in line.replace("·", " ").split()
}
# What the whole package is to its users; and what starts the command line.
OUTSIDE = {"__init__", "__main__"}
KERNELS_MAY_IMPORT = {"math", "numpy"}
# How kernels are compiled and kept, and how they get at arrays: no mathematics there.
AROUND_KERNELS = {"code_cache.py", "compiling.py", "given.py", "interruptible.py", "memory.py"}


def unit_of(path):
    """The name in the picture of the file at *path*."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def all_files():
    return sorted(path for path in PACKAGE.rglob("*.py") if "__pycache__" not in path.parts)


def imports(path):
    """Modules that a file imports, wherever in it, with the line; a type checker's imports as well."""
    for statement in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(statement, ast.Import):
            yield from ((alias.name, statement.lineno) for alias in statement.names)
        elif isinstance(statement, ast.ImportFrom):
            assert statement.level == 0, f"{path.name}:{statement.lineno} imports relatively"
            if statement.module == "proximity":
                names = (f"proximity.{alias.name}" for alias in statement.names)
                yield from ((name, statement.lineno) for name in names)
            else:
                yield statement.module, statement.lineno


def test_picture_names_every_unit_once():
    present = {unit_of(path) for path in all_files()} - OUTSIDE

    assert set(LEVEL) == present
    assert len(LAYERS.replace("·", " ").split()) == len(LEVEL)


@pytest.mark.parametrize(
    "path",
    [path for path in all_files() if unit_of(path) not in OUTSIDE],
    ids=lambda path: str(path.relative_to(PACKAGE)),
)
def test_file_imports_only_from_lines_below(path):
    own = unit_of(path)
    for name, line in imports(path):
        parts = name.split(".")
        if parts[0] != "proximity" or (len(parts) > 1 and parts[1] == own):
            continue
        # The command line is a user: it asks for public names, which are imported when first needed.
        if own == "cli" and (len(parts) == 1 or parts[1] in {*proximity.__all__, "__version__"}):
            continue
        assert len(parts) > 1 and parts[1] in LEVEL, f"line {line}: import {name} from the module that has it"
        assert LEVEL[parts[1]] < LEVEL[own], f"line {line}: {own} may not import {parts[1]}"


@pytest.mark.parametrize(
    "path",
    [path for path in all_files() if unit_of(path) == "kernels" and path.name not in AROUND_KERNELS],
    ids=lambda path: path.name,
)
def test_kernels_know_numbers_only(path):
    for name, line in imports(path):
        top = name.split(".")[0]
        assert top == "proximity" or top in KERNELS_MAY_IMPORT, f"line {line}: a kernel may not import {name}"


def test_kernels_of_simulations_lie_where_changes_are_noticed():
    """Compiled code is kept until a file of `decaff` that is named so changes (`kernels.compiler`)."""
    for path in all_files():
        if unit_of(path) == "decaff" and "proximity.kernels.compiler" in {name for name, _ in imports(path)}:
            assert path.name.endswith("_kernels.py"), path.name


def test_only_lower_units_are_named_by_those_that_know_no_files():
    """Walls: neither a solid nor a scene knows files, and no mathematics is in the command line."""
    for path in all_files():
        used = {name.split(".")[1] for name, _ in imports(path) if name.startswith("proximity.")}
        if unit_of(path) in ("solid", "scene", "queries"):
            assert not used & {"meshio", "loading"}, path.name
        if unit_of(path) == "solid":
            assert "bodies" not in used
        if unit_of(path) == "cli":
            assert not used & {"kernels", "simd", "model", "bvh", "sign"}, path.name
