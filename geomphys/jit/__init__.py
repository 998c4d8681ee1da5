"""From kernels to machine code by numba's public interface: once per machine and version, on two cores at once."""

from geomphys.storage.deferred_signals import signals_deferred

with signals_deferred():  # one of its C modules prints a traceback where a signal ends its import
    import numba as numba
