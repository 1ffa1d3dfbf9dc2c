"""Cache in memory of a limited number of items."""

from collections import OrderedDict
from typing import Generic, TypeVar

K = TypeVar("K")
V = TypeVar("V")


class RecentItems(Generic[K, V]):
    """Cache of a limited number of items by key; the least recently used item is removed first.

    Parameters
    ----------
    max_items : int
        Largest number of items that are kept.
    """

    def __init__(self, max_items: int):
        self.max_items = max_items
        self._items: OrderedDict[K, V] = OrderedDict()

    def __len__(self) -> int:
        return len(self._items)

    def get(self, key: K) -> V | None:
        """Return the item of a key, which counts as a use of it; None if it is missing."""
        try:
            self._items.move_to_end(key)
        except KeyError:
            return None
        return self._items.get(key)  # another thread may have removed it

    def put(self, key: K, item: V) -> None:
        """Store an item; if there are then too many, remove the least recently used ones."""
        self._items[key] = item
        self._items.move_to_end(key)
        while len(self._items) > self.max_items:
            self._items.popitem(last=False)

    def clear(self) -> None:
        """Remove all items."""
        self._items.clear()
