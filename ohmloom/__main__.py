"""``python -m ohmloom`` is the command ``ohmloom``."""

from ohmloom.cli import main

if __name__ == "__main__":
    main()
