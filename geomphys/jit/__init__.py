"""From kernels to machine code by numba: once per machine and version, by several processes at once.

What is compiled is loaded without numba, which is imported only where something has to be compiled.
"""
