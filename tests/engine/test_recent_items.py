"""Store of a bounded number of items in memory."""

from sepmc.recent_items import RecentItems


def test_items_used_last_stay():
    items: RecentItems[str, int] = RecentItems(2)
    items.put("a", 1)
    items.put("b", 2)
    assert items.get("a") == 1  # used after b
    items.put("c", 3)
    assert [items.get(key) for key in "abc"] == [1, None, 3]
    items.put("a", 4)
    items.put("d", 5)
    assert [items.get(key) for key in "acd"] == [4, None, 5]
    assert len(items) == 2
    items.clear()
    assert len(items) == 0
