"""Paths of the project, its sample parts and its tests."""

from pathlib import Path

TESTS = Path(__file__).resolve().parent.parent
ROOT = TESTS.parent
MESHES = ROOT / "meshes"
SUPPORT = TESTS / "support"
TRIALS = TESTS / "trials"
SHARED_DATA = ROOT.parent / "shared" / "data"
RECORDED_HANDS = [
    SHARED_DATA / "hands" / f"{name}.csv" for name in ("grab", "hand-splay", "two-hands", "waiting", "wave")
]
IMPORT_PATHS = [str(SUPPORT), str(SUPPORT / "messages"), str(TRIALS), str(ROOT)]
"""PYTHONPATH for programs started by tests."""
