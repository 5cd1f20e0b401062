"""Check that optional parts of the package are installed, with errors that state what to install."""

from collections.abc import Iterator
from contextlib import contextmanager

from proximity.errors import ArgumentError, MissingLibraryError

DISTRIBUTION = "cad-proximity"
"""Name of this project on the package index, where ``proximity`` is another project."""
PACKAGES = {"pyvista": "PyVista"}
"""Names of packages by the names of their modules, if they differ."""


def installation(extra: str) -> str:
    """Return the command that installs an optional part of the package."""
    return f'pip install "{DISTRIBUTION}[{extra}]"'


@contextmanager
def needed(sentence: str, extra: str) -> Iterator[None]:
    """Convert an import error in the block to an error that names the library and how to install it."""
    try:
        yield
    except ImportError as missing:
        module = (missing.name or "a library").partition(".")[0]
        package = PACKAGES.get(module, module)
        is_there = not isinstance(missing, ModuleNotFoundError)
        how = f"cannot be imported ({missing})" if is_there else "is not installed"
        raise MissingLibraryError(
            f"{sentence} {package}, which {how}: {installation(extra)}, or in a checkout "
            f'pip install -e ".[{extra}]"'
        ) from missing


@contextmanager
def needed_in_c(sentence: str) -> Iterator[None]:
    """Convert a failure to load C code in the block to an `ArgumentError` that states how to compile it."""
    try:
        yield
    except ImportError as missing:
        raise ArgumentError(
            f"{sentence}: {missing}; compile it by `python tools/build_kernels.py` in the checkout, or "
            "reinstall the package"
        ) from None
