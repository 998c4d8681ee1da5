"""``python -m geomphys``: the command line where the `geomphys` script is not on the path."""

from runpy import run_module

if __name__ == "__main__":
    run_module("geomphys_cli", run_name="__main__", alter_sys=True)
