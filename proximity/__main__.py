"""The command line, as ``proximity`` and as ``python -m proximity``."""

import sys


def main() -> None:
    """Run the command line; Ctrl-C is quiet while it is imported as well."""
    try:
        from proximity import cli
    except KeyboardInterrupt:
        sys.exit(130)  # `EXIT_INTERRUPTED`, which is not there yet
    cli.main()


if __name__ == "__main__":
    main()
