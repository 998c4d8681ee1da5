"""``python -m geomphys_cli``: the command line where the `geomphys` script is not on the path."""

from .entry import main

if __name__ == "__main__":
    main()
