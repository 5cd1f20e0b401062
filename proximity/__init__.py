"""Compute exact distances from points, rays and segments to CAD parts.

>>> import proximity
>>> scene = proximity.load("bracket.stl")
>>> hit = scene.closest([0.03, 0.01, 0.005])
>>> hit.signed_distance, hit.point, hit.gradient

Lengths are in metres, and the signed distance is negative inside. The names below are the public interface.
They are imported on first access, so that ``import proximity`` alone takes milliseconds and compiles no
kernels.
"""

import os
import warnings
from importlib import import_module
from typing import Any

__version__ = "0.1.0"


def _module_of_each_name() -> dict[str, str]:
    """Return the module of each public name.

    They are read from the lines ``from module import Name as Name`` of the stub.
    """
    with open(__file__.removesuffix(".py") + ".pyi", encoding="utf-8") as stub:
        lines = [line.split() for line in stub]
    return {words[3]: words[1] for words in lines if words[:1] == ["from"]}


def _warn_of_namesake() -> None:
    """Warn if the distribution ``proximity`` is in the same folder, where both write this file."""
    names = os.listdir(os.path.dirname(os.path.dirname(__file__)))
    if any(name.startswith("proximity-") and name.endswith(".dist-info") for name in names):
        warnings.warn(
            "another distribution, named proximity, is installed in the same folder and replaces files of "
            "cad-proximity: run `pip uninstall proximity cad-proximity`, then `pip install cad-proximity`",
            RuntimeWarning,
            stacklevel=3,
        )


_warn_of_namesake()
_MODULE_OF = _module_of_each_name()


def _constants_then_classes_then_functions(name: str) -> tuple[int, str]:
    return 0 if name.isupper() else 1 if name[0].isupper() else 2, name


__all__ = sorted(_MODULE_OF, key=_constants_then_classes_then_functions)


def __getattr__(name: str) -> Any:
    """Import a public name on first access and store it."""
    module = _MODULE_OF.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted([*__all__, "__version__"])
