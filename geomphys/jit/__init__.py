"""From kernels to machine code by numba's public interface: once per machine and version, on two cores at once.

What is compiled is loaded without numba, which is imported only where something has to be compiled.
"""
