"""What a function returns for given types of arguments, found once. Numba tries every overload of
an operator again at each of its calls, a fifth of the time that a piece takes to compile.

Only for processes that do nothing but fill the cache.
"""

from typing import Any

from numba.core.types.functions import BaseFunction


def cache_call_types() -> None:
    """Let Numba keep what it finds, for the life of the process."""
    find = BaseFunction.get_call_type

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        kept = self.__dict__.setdefault("_sepmc_kept", {})
        try:
            key = (id(context), args, tuple(sorted(kws.items())))
            known = kept.get(key)
        except TypeError:  # not hashable
            return find(self, context, args, kws)
        if known is None:
            known = kept[key] = find(self, context, args, kws)
        return known

    setattr(BaseFunction, "get_call_type", get_call_type)  # noqa: B010  (a method, says mypy)
