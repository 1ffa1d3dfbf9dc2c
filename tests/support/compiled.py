"""Formulas and routines as compiled code, called from Python."""

import ctypes
import functools
import itertools

import numpy as np

from sepmc.engine import cache_files
from sepmc.translator import compiler
from sepmc.translator.module import Module
from sepmc.translator.sources import source_of
from sepmc.translator.values import BOOL, FLOAT, INT, POINTER, Array, Number, leaves, rebuilt
from sepmc.translator.writer import Writer

_C = {FLOAT: ctypes.c_double, INT: ctypes.c_int64, BOOL: ctypes.c_bool, POINTER: ctypes.c_void_p}
_counter = itertools.count()
_engines = []


@functools.cache
def compiled(function):
    """The compiled form of a function: takes and returns Python's numbers, tuples of them and
    arrays, as the function. Each Python type of the arguments is compiled once."""
    made = {}

    @functools.wraps(function)
    def call(*arguments):
        key = tuple(map(_form, arguments))
        if key not in made:
            made[key] = _compile(function, arguments)
        return made[key](arguments)

    return call


def _form(value):
    if isinstance(value, tuple):
        return tuple(map(_form, value))
    return (value.dtype, value.ndim) if isinstance(value, np.ndarray) else _kind(value)


def _kind(value):
    if isinstance(value, bool | np.bool_):
        return BOOL
    return INT if isinstance(value, int | np.integer) else FLOAT


def _numbers(value):
    """Numbers of an argument that are passed to compiled code."""
    if isinstance(value, tuple):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, np.ndarray):
        assert value.flags.c_contiguous
        yield value.ctypes.data
        yield from value.shape
    else:
        yield value


def _value(value, parameters):
    """Value of an argument in compiled code."""
    if isinstance(value, tuple):
        return tuple(_value(item, parameters) for item in value)
    if isinstance(value, np.ndarray):
        element = FLOAT if value.dtype == np.float64 else INT
        data = next(parameters)(POINTER)
        return Array(element, data, tuple(next(parameters)(INT) for _ in value.shape))
    return next(parameters)(_kind(value))


def _compile(function, arguments):
    module, name, passed = Module(), f"test_{next(_counter)}", []

    def parameter(kind):
        passed.append(Number(kind, f"%a{len(passed)}"))
        return passed[-1]

    out = parameter(POINTER)
    writer = Writer(module)
    values = tuple(_value(value, itertools.repeat(parameter)) for value in arguments)
    result = module.call(writer, source_of(function), values)
    kinds = [leaf.kind for leaf in leaves(result)]
    for k, leaf in enumerate(leaves(result)):
        pointer = writer.emit(POINTER, f"getelementptr i64, ptr {out.text}, i64 {k}")
        writer.run(f"store {leaf.kind} {leaf.text}, ptr {pointer.text}")
    writer.run("ret void")
    writer.define(f"void @{name}", passed)
    code = compiler.target_machine().emit_object(compiler.optimised(module.text()))
    (address,), engine = cache_files._link([([name], code)])
    _engines.append(engine)
    entry = ctypes.CFUNCTYPE(None, *(_C[number.kind] for number in passed))(address)
    buffer = (ctypes.c_int64 * max(1, len(kinds)))()
    places = [_C[kind].from_buffer(buffer, 8 * k) for k, kind in enumerate(kinds)]

    def call(arguments):
        entry(ctypes.addressof(buffer), *_numbers(arguments))
        found = rebuilt(result, iter([place.value for place in places]))
        return found if found != () else None

    return call
