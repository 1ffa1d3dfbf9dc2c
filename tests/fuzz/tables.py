"""Input tables, CSV and Parquet: invalid numbers and names, types, sizes, damage."""

import datetime
import decimal
import math
import tomllib

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from fuzz import mutate
from fuzz.places import scratch
from fuzz.watch import Wrong, turns
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.store.sample_file import read_input_table
from sepmc.scene.read import parse_campaign

SCENE = mutate.SMALL
INPUTS = ("in_body_a_mass_kg", "in_body_b_mass_kg")
_TYPES = (
    pa.float64(), pa.float32(), pa.float16(), pa.int8(), pa.int64(), pa.uint64(), pa.string(),
    pa.bool_(), pa.timestamp("ns"), pa.duration("ns"), pa.date32(), pa.time64("us"),
    pa.decimal128(20, 3), pa.list_(pa.float64()), pa.struct([("x", pa.float64())]), pa.binary(),
    pa.null(), pa.dictionary(pa.int32(), pa.string()), pa.large_string(),
    pa.map_(pa.string(), pa.float64()), pa.timestamp("us", "UTC"), pa.timestamp("s", "Nowhere/X"),
)  # fmt: skip
_METADATA = (
    {b"pandas": b"{"}, {b"pandas": b"[]"}, {b"pandas": b'{"index_columns": ["case"]}'},
    {b"pandas": b'{"columns": [{"name": 1}], "index_columns": [7]}'}, {b"x": b"\xff"},
    {b"pandas": b'{"index_columns": [{"kind": "range", "start": 0, "stop": 1e99, "step": 0}]}'},
)  # fmt: skip


def tables(rng, count, until, tried):
    """Tables for a campaign with two dispersed masses."""
    tree = tomllib.loads(SCENE)
    with scratch() as folder:
        for number in turns(count, until, tried):
            name = f"{number % 8}.{rng.choice(('csv', 'parquet'))}"
            path = folder / name
            rows = rng.choice((0, 1, 2, 3, 8, 40))
            if path.suffix == ".csv":
                path.write_bytes(_csv(rng, rows))
            else:
                _parquet(rng, rows, path)
            plan = tree | {"run": tree["run"] | {"samples": name}}
            said = (name, path.read_bytes()[:2000] if path.suffix == ".csv" else _told(path))
            tried.look(said, lambda plan=plan, path=path: _flown_as_given(plan, folder, path))


def _told(path):
    try:
        return str(pq.read_schema(path))
    except Exception as error:
        return f"no Parquet: {error}"


def _flown_as_given(plan, folder, path):
    """Check that the accepted inputs are the numbers of the table, to the last bit."""
    campaign = Campaign(parse_campaign(plan, "plan.toml", folder=folder, reader=read_input_table))
    numbers, _ = campaign.select_cases()
    first = numbers.ranges[0][0]
    drawn = campaign.sample(first, 1)[0]
    _ = campaign.digest, campaign.columns
    used = {d.column: k for k, d in enumerate(campaign.file.dispersions) if d.column}
    if not used:
        raise Wrong("a plan that gives nothing was accepted")
    if not np.isfinite(drawn).all() or (drawn <= 0.0).any():
        raise Wrong(f"{drawn} was accepted as masses")
    if path.suffix == ".csv":
        return
    given = pq.read_table(path)
    names = [name.strip() for name in given.column_names]
    for name, k in used.items():
        column = given.column(names.index(name)).to_pylist()
        place = 0
        if "case" in names:
            place = [int(x) for x in given.column(names.index("case")).to_pylist()].index(first)
        if isinstance(column[place], bool) or float(column[place]) != drawn[k]:
            raise Wrong(f"{column[place]!r} became {drawn[k]}")


def _csv(rng, rows):
    """A table as text, damaged in some."""
    names = list(rng.choice((INPUTS, ("case", *INPUTS), ("case", *INPUTS, "x"))))
    if rng.random() < 0.2:
        names[rng.randrange(len(names))] = rng.choice((*mutate.NAMES, *INPUTS, "in_x", " case "))
    ending = rng.choice(("\n", "\n", "\r\n", "\r"))
    lines = [",".join(names)]
    odd = rng.random() < 0.5
    for k in range(rows):
        cells = [str(k) if name == "case" else f"{rng.uniform(0.5, 2.0)}" for name in names]
        if odd and rng.random() < 0.2:
            place = rng.randrange(len(cells))
            cells[place] = _cell(rng)
        lines.append(",".join(cells))
    text = bytearray((ending.join(lines) + ending).encode(errors="replace"))
    if rng.random() < 0.3:
        for _ in range(rng.choice((1, 2, 5))):
            place = rng.randrange(len(text) or 1)
            if rng.random() < 0.5 and text:
                text[place] ^= 1 << rng.randrange(8)
            else:
                text[place : place + rng.randrange(9)] = rng.choice(
                    (b"", b'"', b",", b"\n", b"\0", b"\xff\xfe", b'""', b",,,,")
                )
    return bytes(text)


def _cell(rng):
    return rng.choice(
        ("", "nan", "NaN", "inf", "-inf", "1e999", "1e308", "-1", "0", "1e15", "9999999999", "abc",
         "true", "2020-01-01", "00:00:01", "0x10", "1_0", "1,5", '"1.0"', " 1.0 ", "1.0f", "null",
         "=cmd()", "9" * 400, "-0.0", "1e-320", "\N{ARABIC-INDIC DIGIT ONE}", "1d", "NA", "+1.5")
    )  # fmt: skip


def _value(rng, kind):
    """A value of a type."""
    whole = rng.choice((0, 1, 2, 3, 100, -1))
    if pa.types.is_floating(kind):
        number = rng.choice((1.0, 1.5, 2.0, 3.0, math.nan, -1.0, 0.0, 1e308, math.inf, 100.0))
        number = number if number != 1e308 or kind == pa.float64() else 7.0
        return np.float16(number) if kind == pa.float16() else number
    for fits, value in (
        (pa.types.is_integer, abs(whole)),
        (pa.types.is_decimal, decimal.Decimal("1.5")),
        (pa.types.is_boolean, whole > 1),
        (pa.types.is_timestamp, datetime.datetime(1970, 1, 1, 0, 0, abs(whole) % 60)),
        (pa.types.is_duration, datetime.timedelta(microseconds=abs(whole))),
        (pa.types.is_date, datetime.date(2020, 1, 1)),
        (pa.types.is_time, datetime.time(0, 0, 1)),
        (pa.types.is_list, [1.0, 2.0]),
        (pa.types.is_map, [("x", 1.0)]),
        (pa.types.is_struct, {"x": 1.0}),
        (pa.types.is_binary, rng.choice((b"1.5", b"\xff"))),
        (pa.types.is_null, None),
    ):
        if fits(kind):
            return value
    return rng.choice(("1.5", "abc", "", "nan", "\x1b[2J"))


def _parquet(rng, rows, path):
    """A Parquet table with columns of any type, damaged in some."""
    names = list(rng.choice((INPUTS, ("case", *INPUTS), ("case", *INPUTS, "x"))))
    if rng.random() < 0.2:
        names[rng.randrange(len(names))] = rng.choice((*mutate.NAMES, *INPUTS, "in_x", " case "))
    arrays = []
    for name in names:
        kind = rng.choice(_TYPES) if rng.random() < 0.3 else pa.float64()
        if name == "case" and rng.random() < 0.8:
            arrays.append(pa.array(range(rows), pa.int64()))
            continue
        good = kind == pa.float64() and rng.random() < 0.7
        values = [rng.uniform(0.5, 2.0) if good else _value(rng, kind) for _ in range(rows)]
        if rng.random() < 0.1 and rows:
            values[rng.randrange(rows)] = None
        arrays.append(pa.array(values, kind))
    metadata = rng.choice(_METADATA) if rng.random() < 0.2 else None
    fields = [
        pa.field(name, array.type, metadata={b"unit": b"\xff"} if rng.random() < 0.05 else None)
        for name, array in zip(names, arrays, strict=True)
    ]
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=metadata))
    try:
        pq.write_table(table, path, compression=rng.choice(("snappy", "none", "zstd", "gzip")))
    except (pa.ArrowException, OSError):
        path.write_bytes(b"PAR1PAR1")
    if rng.random() < 0.4:
        damage(rng, path)


def damage(rng, path):
    """Flip bits of a file, mostly of its footer, or truncate it."""
    said = bytearray(path.read_bytes())
    if not said:
        return
    for _ in range(rng.choice((1, 1, 3, 10))):
        place = rng.randrange(len(said))
        if rng.random() < 0.7:
            place = max(0, len(said) - 1 - rng.randrange(min(len(said), 1200)))
        said[place] = rng.choice((said[place] ^ (1 << rng.randrange(8)), 255, 0, 127))
    if rng.random() < 0.1:
        del said[rng.randrange(len(said)) :]
    path.write_bytes(bytes(said))
