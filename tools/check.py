"""Check format, lint and types: ``python tools/check.py``; ``--fix`` applies automatic fixes."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CHECKS = (("ruff", "format", "--check", "."), ("ruff", "check", "."), ("mypy",))
MENDING = (("ruff", "format", "."), ("ruff", "check", "--fix", "."), ("mypy",))


def main() -> int:
    """Run all checks to the end; return the number of failures."""
    failed = []
    for words in MENDING if "--fix" in sys.argv[1:] else CHECKS:
        print("$", *words, flush=True)
        if subprocess.run([sys.executable, "-m", *words], cwd=ROOT).returncode:
            failed.append(" ".join(words))
    print(f"failed: {', '.join(failed)}" if failed else "all checks passed")
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
