"""Cache of the types that Numba functions return for given argument types. Numba tries every
overload of an operator again at each call, a fifth of the time to compile a unit.

Only for processes that do nothing but compile.
"""

from typing import Any

from numba.core.types.functions import BaseFunction


def cache_call_types() -> None:
    """Let Numba cache, for the life of the process, the signature that it finds for a call of a
    function with given argument types."""
    find_type = BaseFunction.get_call_type

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        cached = self.__dict__.setdefault("_sepmc_types", {})
        try:
            key = (id(context), args, tuple(sorted(kws.items())))
            known = cached.get(key)
        except TypeError:  # not hashable
            return find_type(self, context, args, kws)
        if known is None:
            known = cached[key] = find_type(self, context, args, kws)
        return known

    setattr(BaseFunction, "get_call_type", get_call_type)  # noqa: B010  (a method, says mypy)
