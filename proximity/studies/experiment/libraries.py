"""Optional libraries of experiments, imported when they are needed."""

from importlib import import_module
from typing import Any

from proximity.errors import DecaffError
from proximity.system.extras import installation


def library(name: str) -> Any:
    """Return a module of the extra ``experiment``.

    Raises
    ------
    DecaffError
        If it is not installed; it says what to install.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as missing:
        raise DecaffError(
            f"experiments need {missing.name}, which is not installed: {installation('experiment')}"
        ) from missing
