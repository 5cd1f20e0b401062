"""Optional parts of the package, and the command that installs them."""

DISTRIBUTION = "cad-proximity"
"""Name on the package index, where ``proximity`` is another project."""


def installation(extra: str) -> str:
    """Return the command that installs an optional part.

    Parameters
    ----------
    extra : str
        Its name in ``pyproject.toml``, under optional dependencies.
    """
    return f'pip install "{DISTRIBUTION}[{extra}]"'
