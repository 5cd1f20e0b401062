"""The layers of the package and its larger parts, compared with imports, paths in strings and C includes."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import proximity
from proximity.native.sources import kernel_sources

ROOT = Path(proximity.__file__).parent.parent
# From top to bottom. A unit (a module or a folder) imports only from lines below its own.
PICTURES = {
    "proximity": """
cli
lab · requirements · web
clients
service
tracker
scene
decaff
formats · recording · transport
mesh · message · pose
core
checks · kernels · system
errors
native
""",
    "proximity.native": """
simd · warm_up
declaration
jit · mode
signature · sources
""",
    "proximity.core": """
loop
mailbox
library
library_in_c · loop_records · receiver
cpython · receiver_state
""",
    "proximity.kernels": """
part · tracking
pair
scene
bodies · point · ray · segment
tree
sign
mesh · traverse
geometry
stack_arrays
compiled_stack · contact_record · entries · nodes
answers · layout · thresholds
""",
    "proximity.kernels.scene": """
store
queries
parts
inside
""",
    "proximity.scene": """
clashes · picture · trimesh_scene
loader · overlap
scene
motion_clearance · scene_parts
pairs
deformation · saved
part
walls
solid
penetration · queries · solid_arrays
motion · sign
model
""",
    "proximity.scene.queries": """
closest_parts
queries
crossings
checked_query
results
html_table
""",
    "proximity.service": """
hosting
loop
loop_parts · loop_watch
loop_ends · loop_memory
held_contacts
inputs
contact_source · sensed_contacts
samples
clock · config · description · finger_kernels · frame_log · realtime · report
""",
    "proximity.service.inputs": """
changes_input · message_input · moves_input
gloves · inbox · part_prediction · sources
""",
    "proximity.web": """
motion_page · running_page
page_process
bridge
saved_page · sources
page_content
geometry
page_inbox
server
display_mesh
""",
    "proximity.decaff": """
calibration · simulated_drums
motors
controller
glove
drum
""",
    "proximity.lab": """
study
certificate
claims · experiment · part_press
figures
engine · stability
simulation
paper
""",
    "proximity.lab.experiment": """
figure · observers · power
analysis
visit
drum_display
display · design_file
plan
design · psychometric
""",
    "proximity.lab.certificate": """
report
certification
measurement
worst_positions
starting_positions
work
motions · subject · times
""",
    "proximity.cli": """
lab
device
parts · service
options
progress
program · tables
output
""",
}
# Parts of the package without a layer: the users' imports, and the start of the command line.
OUTSIDE = {"__init__", "__main__"}
NAMES_SOURCES = {"proximity.native.sources"}  # reads all compiled sources, as bytes
NO_FILES = {f"proximity.scene.{name}" for name in ("solid", "scene", "scene_parts", "queries.queries")}
KERNELS_MAY_IMPORT = {"math", "numpy", "typing"}  # typing: named tuples of arrays
NUMBA_MAY_BE_IMPORTED_BY = {
    "proximity.kernels.compiled_stack", "proximity.native.jit", "proximity.native.simd.compiled",
    "proximity.native.simd.vectors", "proximity.native.warm_up",
}  # fmt: skip
# Names of `proximity.native` that declare kernels: files that import them are sources of kernels.
DECLARATIONS = {"bundle", "entry", "inlined", "kernel", "allocating_kernel"}


def module_of(path):
    """Return the name under which the file at *path* is imported."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


FILES = {
    module_of(path): path
    for path in sorted((ROOT / "proximity").rglob("*.py"))
    if "__pycache__" not in path.parts
}
PACKAGES = sorted(module for module, path in FILES.items() if path.name == "__init__.py")


@cache
def imports(path):
    """Return the modules of this package, or names in others, that a file imports, each with its line."""
    found = []
    for statement in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(statement, ast.Import):
            found += ((alias.name, statement.lineno) for alias in statement.names)
        elif isinstance(statement, ast.ImportFrom):
            assert statement.level == 0, f"{path.name}:{statement.lineno} imports relatively"
            for alias in statement.names:
                name = f"{statement.module}.{alias.name}"
                is_module = name in FILES or statement.module == "proximity"
                found.append((name if is_module else statement.module, statement.lineno))
    return found


C_FILES = {
    module_of(path.with_name(path.name.removesuffix(".in").replace(".", "_"))): path
    for path in sorted((ROOT / "proximity").rglob("*"))
    if path.name.removesuffix(".in").endswith((".c", ".h", ".cpp", ".hpp"))
}
ALL_FILES = FILES | C_FILES
HEADERS = {path.name.removesuffix(".in"): module for module, path in C_FILES.items()}


def includes(path):
    """Yield the package's files that a C file includes, each with its line, except generated ones."""
    text = path.read_text(encoding="utf-8")
    for found in re.finditer(r'^#include ["<](\w+\.\w+)[">]', text, re.MULTILINE):
        if found[1] in HEADERS:
            yield HEADERS[found[1]], text.count("\n", 0, found.start()) + 1


def paths_in_strings(path):
    """Yield units of the package whose folders a file names, each with its line."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    joins = (each for each in ast.walk(tree) if isinstance(each, ast.BinOp) and isinstance(each.op, ast.Div))
    joined = [each.right for each in joins if "__file__" in ast.dump(each.left)]
    for constant in ast.walk(tree):
        if isinstance(constant, ast.Constant) and isinstance(constant.value, str):
            first, *others = constant.value.split("/")
            if (others or constant in joined) and first in levels_of("proximity"):
                yield f"proximity.{first}", constant.lineno


def everything_named(module, path):
    """Return a file's dependencies: Python imports, paths in strings, or C includes."""
    if module in C_FILES:
        return [*includes(path)]
    return imports(path) + ([] if module in NAMES_SOURCES else [*paths_in_strings(path)])


def unit_of(module, package):
    """Return the unit directly in *package* that a module belongs to, or None."""
    rest = module.removeprefix(package + ".")
    return None if rest == module else rest.split(".")[0]


def levels_of(package):
    """Return the units of a picture with their heights; 0 is the lowest."""
    rows = PICTURES[package].strip().split("\n")
    return {unit: height for height, row in enumerate(reversed(rows)) for unit in row.split(" · ")}


def units_in(package):
    units = {unit_of(module, package) for module in ALL_FILES}
    return units - {None, *OUTSIDE}


@pytest.mark.parametrize("package", PICTURES)
def test_picture_names_every_unit_once(package):
    assert set(levels_of(package)) == units_in(package)
    assert len(PICTURES[package].replace(" · ", "\n").split()) == len(units_in(package))


@pytest.mark.parametrize("package", PICTURES)
def test_units_import_only_from_lines_below(package):
    level = levels_of(package)
    for module, path in ALL_FILES.items():
        own = unit_of(module, package)
        if own is None or own in OUTSIDE:
            continue
        for name, line in everything_named(module, path):
            other = unit_of(name, package)
            # The command line imports public names lazily, like a user.
            is_public = package == "proximity" and other in {*proximity.__all__, "__version__"}
            if other is None or other == own or (own == "cli" and is_public):
                continue
            assert other in level, f"{path.name}:{line}: import {name} from the module that has it"
            assert level[other] < level[own], f"{path.name}:{line}: {own} may not import {other}"


@pytest.mark.parametrize("package", PACKAGES)
def test_no_circle_of_imports(package):
    graph = TopologicalSorter()
    for module, path in FILES.items():
        own = unit_of(module, package)
        others = {unit_of(name, package) for name, _ in imports(path)} - {None, own}
        if own is not None and own not in OUTSIDE:
            graph.add(own, *others)
    try:
        graph.prepare()
    except CycleError as error:
        pytest.fail(f"{package}: {' imports '.join(reversed(error.args[1]))}")


@pytest.mark.parametrize(
    "module",
    [
        module
        for module, path in FILES.items()
        if unit_of(module, "proximity") == "kernels" and module not in NUMBA_MAY_BE_IMPORTED_BY
    ],
)
def test_kernels_know_numbers_only(module):
    for name, line in imports(FILES[module]):
        top = name.split(".")[0]
        assert top == "proximity" or top in KERNELS_MAY_IMPORT, f"line {line}: a kernel may not import {name}"


def test_nobody_else_imports_the_compiler():
    """Kernels compiled ahead of time run without it."""
    importing = {
        module
        for module, path in FILES.items()
        if {name.split(".")[0] for name, _ in imports(path)} & {"numba", "llvmlite"}
    }

    assert importing == NUMBA_MAY_BE_IMPORTED_BY


def test_kernels_lie_where_changes_are_noticed():
    """Compiled kernels are used until one of the files in `native.sources` changes."""
    noticed = set(kernel_sources())
    for module, path in FILES.items():
        declares = {
            alias.name
            for statement in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(statement, ast.ImportFrom) and statement.module == "proximity.native"
            for alias in statement.names
        } & DECLARATIONS
        assert not declares or path in noticed, module


def test_only_lower_units_are_named_by_those_that_know_no_files():
    """Solids and scenes do not read files, and the command line does not compute."""
    for module, path in FILES.items():
        used = {unit_of(name, "proximity") for name, _ in imports(path)}
        if module in NO_FILES:
            assert "formats" not in used, module
        if module == "proximity.scene.solid":
            assert not any(name.startswith("proximity.mesh.body") for name, _ in imports(path))
        if unit_of(module, "proximity") == "cli":
            assert not used & {"kernels", "native"}, module
