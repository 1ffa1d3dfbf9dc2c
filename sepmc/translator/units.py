"""Compile units: functions of a kernel that are compiled separately and call each other by address.
The first argument of each is the kernel's workspace (the buffer of floats of a block of cases).

The addresses of all units of a kernel are stored in memory just before its workspace
(`sepmc.engine.written_kernel.table`), so a unit finds the others through its first argument.
"""

from typing import Any

from sepmc.translator.values import FLOAT, INT, POINTER, Array, Number

TYPES = {"i": INT, "f": FLOAT, "a": POINTER}


class callee:
    """Reference to a compile unit by its position, which lets another unit call it by its address.

    The source of the calling unit has it under the name of the called function: the translator
    writes a call of that name by `call`.

    Parameters
    ----------
    position : int
        Index of the called unit among the units of the kernel: its address is stored
        ``position + 1`` integers before the start of the workspace.
    codes : str
        Types of its arguments after the workspace, as in `compile_unit`.
    """

    def __init__(self, position: int, codes: str):
        self.position, self.codes = position, codes

    def call(self, f: Any, w: Array, *numbers: Any) -> tuple[()]:
        """Add instructions to ``f`` (a `functions.Function` in translation) that call the unit with
        the workspace ``w`` and further arguments, numbers of which are converted to the types that
        the unit takes; return (), since units return nothing."""
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
    """Create a decorator that states the argument types of a compile unit. The translator reads it
    from the source; in Python it returns the function unchanged.

    Parameters
    ----------
    codes : str
        A letter for each argument after the workspace: "i" integer, "f" floating point, "a" pointer
        to the arguments of the kernel (`sepmc.routines.arrays`).

    Returns
    -------
    callable
    """
    return lambda function: function


def workspace(address: Any) -> Any:
    """Return the workspace at the address of its first number. In translated code it is a 1-D array
    of floats without bounds checks; in Python the argument is returned as it is."""
    return address
