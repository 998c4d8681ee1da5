"""Compiled kernels: decorators, records, and the stage clock."""
