"""``python -m ohmloom`` and the command ``ohmloom``."""

import sys


def run() -> None:
    """Run the command line; Ctrl-C is quiet even while its modules are still being read."""
    try:
        from ohmloom.cli import main
    except KeyboardInterrupt:
        sys.exit(130)
    main()


if __name__ == "__main__":
    run()
