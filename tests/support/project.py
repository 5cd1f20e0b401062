"""Where the project, its sample parts and its tests are."""

from pathlib import Path

TESTS = Path(__file__).resolve().parent.parent
ROOT = TESTS.parent
MESHES = ROOT / "meshes"
SUPPORT = TESTS / "support"
TRIALS = TESTS / "trials"
SHARED_DATA = ROOT.parent / "shared" / "data"
IMPORT_PATHS = [str(SUPPORT), str(SUPPORT / "messages"), str(TRIALS), str(ROOT)]
"""What programs started by tests need on PYTHONPATH."""
