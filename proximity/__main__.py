"""Run the command line, as ``proximity`` or as ``python -m proximity``."""

import sys


def main() -> None:
    """Run the command line. Ctrl-C prints no traceback, even during the import."""
    try:
        import proximity

        if not hasattr(proximity, "__version__"):
            sys.exit("proximity: another distribution, named proximity, has replaced files of cad-proximity")
        from proximity import cli
    except KeyboardInterrupt:
        sys.exit(130)  # `EXIT_INTERRUPTED`, which is not imported yet
    cli.main()


if __name__ == "__main__":
    main()
