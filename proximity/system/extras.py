"""Optional parts of the package, and the message that says what to install if one is missing."""

from collections.abc import Iterator
from contextlib import contextmanager

from proximity.errors import ArgumentError, MissingLibraryError

DISTRIBUTION = "cad-proximity"
"""Name on the package index, where ``proximity`` is another project."""
PACKAGES = {"pyvista": "PyVista"}
"""Names of packages by module, if they differ."""


def installation(extra: str) -> str:
    """Return the command that installs an optional part."""
    return f'pip install "{DISTRIBUTION}[{extra}]"'


@contextmanager
def needed(sentence: str, extra: str) -> Iterator[None]:
    """Raise with the missing library and its installation if an import within the block fails."""
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
    """Raise `ArgumentError` if C code loaded within the block is missing, with how to compile it."""
    try:
        yield
    except ImportError as missing:
        raise ArgumentError(
            f"{sentence}: {missing}; compile it by `python tools/build_kernels.py` in the checkout, or "
            "reinstall the package"
        ) from None
