"""Limits on the size of files, which may be untrusted: larger ones are rejected, with their size,
before they are processed."""

import math
import re
import stat
from pathlib import Path
from typing import Any

from sepmc.scene.messages import Problems, shorten

# Bytes of a campaign file: reading TOML takes 0.7 s for each MB. Shipped ones have 20 kB.
CAMPAIGN_BYTES = 4_000_000
# Bytes of a table of samples: it is read as a whole, and takes up to four times that as numbers.
PLAN_BYTES = 1_000_000_000
# Cases of a campaign, and one more than the largest number of one.
CASES = 10**9
# Largest seed: JSON and Parquet readers take integers of 64 bits.
SEED = 2**63 - 1
# Cases times parameters of a Latin hypercube or a Saltelli design, which is sampled as a whole: 8
# bytes each.
DESIGN_NUMBERS = 300_000_000
# Rows times columns of a table of samples, 8 bytes each: a small file may unpack to any number.
PLAN_NUMBERS = 100_000_000
# Bytes of a manifest: it lists sessions and notes, not cases.
MANIFEST_BYTES = 8_000_000
# Bytes and lines of the list of the files of a run: a billion cases have 120,000 shards.
LEDGER_BYTES = 128_000_000
LEDGER_LINES = 500_000
# Bytes of a shard, which is read as a whole: a run writes at most some 64 MB into one.
PART_BYTES = 256_000_000
# Numbers per byte of a shard: 8 bytes each, of which Snappy makes 3 of 64 at best.
NUMBERS_A_BYTE = 4
# Nested tables: a condition has two for each `any` or `all`.
DEPTH = 32
# Parts of a dotted key: reading takes time with the square of their number.
KEY_PARTS = 100
# Characters of a text, and of a name, which names columns, figures and folders.
TEXT = 2000
NAME = 64
# Squares and cubes of larger numbers may overflow.
LARGEST = 1e60
# A shorter vector has no direction: the square of its length underflows.
SMALLEST = 1e-60
# rad, with round-off of degrees: the largest width of a sector.
FULL_TURN = 2.0 * math.pi * (1.0 + 1e-12)
# Values of a list, such as the points of an outline.
LIST = 20_000
# Rows of a table along an axis: fitting a spline takes time with the cube of their number.
TABLE_ROWS = 1000
# Rows of an aerodynamic table over two or three axes: up to 64 coefficients each.
TABLE_CELLS = 100_000
# Entries of a table, by its name: kernels and compile times grow with them.
ITEMS = {
    "body": 64,
    "joint": 128,
    "motor": 128,
    "spring": 128,
    "load": 128,
    "signal": 64,
    "proximity": 64,
    "phase": 64,
    "release": 128,
    "event": 128,
    "clearance": 128,
    "outline": 256,
    "requirement": 256,
    "correlation": 256,
    "dispersion": 2000,
    "outcome": 2000,
    "scenario": 64,
    "measurement": 64,
    "discrete": 1000,
    "weights": 1000,
    "parameters": 500,
}
_WHOLE = 2**63
_BETWEEN_KEYS = re.compile(r"([={},\[\]\n])")


def read_limited(path: Path, most: int) -> bytes:
    """Return the contents of a file of at most ``most`` bytes. Raises OSError if it cannot be read,
    ValueError if it is no regular file or is larger."""
    state = path.stat()
    if not stat.S_ISREG(state.st_mode):
        raise ValueError("is no regular file")
    if state.st_size <= most:
        with path.open("rb") as file:
            read = file.read(most + 1)
        if len(read) <= most:
            return read
    raise ValueError(f"has {max(state.st_size, most + 1):,} bytes: must be at most {most:,}")


def check_keys(text: str) -> str:
    """Return an error text if a TOML text has a dotted key with more than `KEY_PARTS` parts, which
    would make parsing slow; else an empty string. Values that end their line, such as formulas,
    may have any number of points."""
    pieces = ["\n", *_BETWEEN_KEYS.split(text), "\n"]
    for before, piece, after in zip(pieces[:-1:2], pieces[1::2], pieces[2::2], strict=True):
        # within its line a mark may be one of a quoted key, such as "=#".a
        is_comment = piece.lstrip().startswith("#") and "\n" in (before, after)
        is_value = before == "=" and after == "\n"
        if not (is_comment or is_value) and piece.count(".") >= KEY_PARTS:
            return f"{shorten(piece.strip())}: a key must have at most {KEY_PARTS} parts"
    return ""


def check_tree(tree: Any, problems: Problems, text: int = TEXT) -> None:
    """Add problems of a TOML or JSON tree: too many entries, too deep nesting, integers of more
    than 64 bits, and texts with more than ``text`` characters or with control characters other
    than tab and newline (a carriage return is one). Keys have at most TEXT characters, and no
    control character at all."""
    stack: list[tuple[Any, str, str, int]] = [(tree, "", "", 0)]
    while stack:
        value, key_path, key, depth = stack.pop()
        if isinstance(value, dict | list):
            most = ITEMS.get(key, LIST)
            if len(value) > most:
                problems.add(
                    key_path or "file", f"has {len(value):,} entries: must be at most {most:,}"
                )
            elif depth > DEPTH:
                problems.add(key_path[:TEXT], f"must be at most {DEPTH} tables deep")
            elif isinstance(value, list):
                stack += [(item, f"{key_path}.{k}", "", depth + 1) for k, item in enumerate(value)]
            else:
                for name, item in value.items():
                    if fault := text_fault(str(name), TEXT):
                        problems.add(f"{key_path}.{shorten(name)}".lstrip("."), fault)
                        continue
                    stack.append((item, f"{key_path}.{name}".lstrip("."), str(name), depth + 1))
        elif isinstance(value, str):
            if fault := text_fault(value.replace("\n", " ").replace("\t", " "), text):
                problems.add(key_path, fault, value)
        elif isinstance(value, int) and not -_WHOLE <= value < _WHOLE:
            bits = value.bit_length() + 1  # with the sign
            reason = f"is a whole number of {bits} bits with its sign: must have at most 64"
            problems.add(key_path, f"{reason}; write a larger one with a point")


def text_fault(text: str, most: int) -> str:
    """Error text if ``text`` has more than ``most`` characters, or control characters (line breaks
    and tabs, too); empty if it is valid."""
    if len(text) > most:
        return f"has {len(text):,} characters: must be at most {most:,}"
    return "" if text.isprintable() else "must be text without control characters"
