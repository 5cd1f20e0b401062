"""The process that converts a STEP file: runs cascadio, imports nothing of this package.

Started by its path; takes its settings as JSON on standard input.
"""

import json
import sys

NO_CASCADIO = 3
"""Exit code where cascadio cannot be imported."""


def main() -> int:
    """Convert one file; return the exit code."""
    settings = json.load(sys.stdin)
    sys.path[:] = settings["path"]
    try:
        import cascadio
    except ImportError:
        return NO_CASCADIO
    # include_brep: every triangle says which CAD face it belongs to
    return cascadio.step_to_glb(
        settings["step"],
        settings["glb"],
        tol_linear=settings["tol_linear"],
        tol_angular=settings["tol_angular"],
        include_brep=True,
    )


if __name__ == "__main__":
    sys.exit(main())
