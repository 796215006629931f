"""Compiling of kernels: their records, their machine code on disk, four numbers at a time."""
