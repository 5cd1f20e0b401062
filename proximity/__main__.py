"""The command line as ``python -m proximity``."""

from proximity.cli import main

if __name__ == "__main__":
    main()
