"""From kernels to machine code by numba's public interface: once per machine and version, on two cores at once."""
