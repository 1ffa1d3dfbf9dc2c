"""Compile units: functions of a workspace and numbers that are compiled one by one and call each
other by address.

The addresses of a kernel's units are stored in front of its workspace, so that a function with the
workspace can call every unit (`sepmc.engine.written_kernel.table`).
"""

from typing import Any

from sepmc.translator.values import FLOAT, INT, POINTER, Array, Number

TYPES = {"i": INT, "f": FLOAT, "a": POINTER}


class callee:
    """Another compile unit, as a function of the workspace and numbers.

    Parameters
    ----------
    position : int
        Number of the unit in the order of the table of addresses.
    codes : str
        Types of its arguments after the workspace, as in `compile_unit`.
    """

    def __init__(self, position: int, codes: str):
        self.position, self.codes = position, codes

    def call(self, f: Any, w: Array, *numbers: Any) -> tuple[()]:
        """Write a call with the workspace ``w`` and numbers into the function ``f``."""
        text = f"getelementptr i64, ptr {w.data.text}, i64 {-1 - self.position}"
        address = f.emit(INT, f"load i64, ptr {f.emit(POINTER, text).text}")
        function = f.emit(POINTER, f"inttoptr i64 {address.text} to ptr")
        operands = [f"ptr {w.data.text}"]
        for value, code in zip(numbers, self.codes, strict=True):
            number: Number = value.data if code == "a" else f.converted(value, TYPES[code])
            operands.append(f"{number.kind} {number.text}")
        f.run(f"call void {function.text}({', '.join(operands)})")
        return ()


def compile_unit(codes: str) -> Any:
    """Create a decorator that marks the function of a compile unit.

    Parameters
    ----------
    codes : str
        A letter for each argument after the workspace: "i" integer, "f" floating point, "a" pointer
        to arrays.

    Returns
    -------
    callable
    """
    return lambda function: function


def workspace(address: Any) -> Any:
    """View of the workspace at a pointer to its first number, as a 1-D array of floats; its length
    is not checked."""
    return address
