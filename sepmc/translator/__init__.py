"""Compiler of kernels: from the Python text of their functions to machine code, by LLVM.

Numba infers types and lowers bytecode in Python, which took four fifths of the time to compile a
kernel. What kernels are written in needs less: types follow from the arguments of a function in one
pass over its syntax tree, which writes LLVM's assembly.
"""
