"""The command line of geomphys: one module a command, each a thin shell on one call of the library."""
