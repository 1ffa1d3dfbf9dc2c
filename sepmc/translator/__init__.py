"""Compiler of kernels: translates the Python source of their functions to LLVM assembly, which LLVM
compiles to machine code.

Kernels use a small subset of Python. The types of all values in a function follow from the types of
its arguments, so one pass over its syntax tree writes the assembly. Numba, which compiles any
bytecode, spends four fifths of the compile time of a kernel on type inference and lowering.
"""
