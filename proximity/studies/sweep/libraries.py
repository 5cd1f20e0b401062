"""Libraries of the extra ``study``, imported when they are needed."""

import importlib
from typing import Any

from proximity.errors import ServiceError
from proximity.system.extras import installation


def library(name: str) -> Any:
    """Return a module.

    Raises
    ------
    ServiceError
        If it is not installed; the message says what to install.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as missing:
        raise ServiceError(
            f"a study needs {name.partition('.')[0]}, which is not installed: {installation('study')}"
        ) from missing
