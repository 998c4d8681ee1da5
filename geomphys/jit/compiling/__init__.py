"""From kernels to machine code: in parts, in several processes, once per machine and version."""
