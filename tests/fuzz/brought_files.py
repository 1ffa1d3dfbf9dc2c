"""Files of the field beside a campaign: thrust curves, decks, soundings, damaged at random."""

import math
from pathlib import Path

from fuzz.places import scratch
from fuzz.watch import Wrong, turns
from sepmc.formats.files import read_files
from sepmc.scene.as_brought import convert_tree
from sepmc.scene.messages import Problems

# file ending, kind and text of small files to start from
SEEDS = (
    (".eng", "motor", "; a\nC6 18 70 0-3 0.01 0.02 E\n0.1 10\n0.3 14\n0.3 5\n1.2 0.0\n;\n"),
    (".csv", "motor", "time (s);thrust (lbf)\n0;1\n0.5;2\n1;0\n"),
    (".csv", "motor", "# x\nTime,Thrust\n[s],[N]\n0,1\n0.5,2\n"),
    (".csv", "aero", "mach,alpha,CA,CN,CMQ\n1,-5,1,2,4\n1,5,1,2,4\n2,5,1,2,4\n2,-5,1,1,1\n"),
    (".csv", "aero", "alpha_deg\tbeta_deg\tCL\tCD\n0\t0\t1\t2\n5\t0\t1\t2\n"),
    (".txt", "aero", " MACH CA CY CLN\n 1.0 0.1 0.2 .3D0\n 2.0 0.1 0.2 0.3\n"),
    (".csv", "air", "height (m);pressure (hPa);temperature (C)\n0;1013;15\n1000;900;5\n"),
    (".csv", "air", "altitude_km,density_kg_per_m3\n0,1.2\n10,0.4\n"),
    (".csv", "wind", "altitude_m,speed_kn,from_deg\n0,5,270\n1000,10,280\n"),
    (
        ".txt",
        "wind",
        "   PRES   HGHT   TEMP   DWPT   RELH   MIXR   DRCT   SKNT\n    hPa      m\n"
        "  980.0    360   10.0    8.0     87   6.90    180      5\n"
        "  850.0   1500    2.0   -1.0     80   4.20    250     20\n",
    ),
    (
        ".dat",
        "aero",
        "1   ***** THE USAF AUTOMATED MISSILE DATCOM *****     CASE   1\n 11  $REFQ SREF=1.0,\n"
        " MACH NO  =  0.8\n SIDESLIP =  0.00 DEG\n"
        "  ALPHA   CN    CM    CA    CY   CLN   CLL\n  -5.0  -1.0  1.0  0.3  0.0  0.0  0.0\n"
        "   5.0   1.0 -1.0  0.3  0.0  0.0  0.0\n  DERIVATIVES (PER DEGREE)\n"
        "  ALPHA  CNA  CMA  CYB  CLNB  CLLB\n  -5.0  9. -9. -2. 1. -.1\n"
        "   5.0  9. -9. -2. 1. -.1\n",
    ),
)  # fmt: skip
_PIECES = (
    ";", ",", "\t", " ", "\n", "\n\n", "#", '"', "0", "-1", "1e999", "nan", "inf", "0,5", "1.5",
    ".", "-", "mach", "CA", "(N)", "[", "]", "ALPHA", "MACH NO =", "NDM", "****", "\x00", "\xff",
    "é", "\u2028", "\x0b", "9" * 400, "_", "e", "1e-320", "case", "CASE   2\n", "PER RADIAN",
)  # fmt: skip
_OPTIONS = (
    {}, {}, {}, {"engine": "C6"}, {"engine": 1}, {"engine": []}, {"case": 2}, {"case": "x"},
    {"sideslip_deg": -1}, {"columns": ["a", "b"]}, {"columns": {"thrust_N": "Thrust"}},
    {"columns": {"normal": {"column": "CA", "scale": "x"}}}, {"columns": 7},
    {"total_impulse_N_s": 12.0}, {"total_impulse_x": 1}, {"interpolation": "linear"},
    {"mirror": "alpha"}, {"above": "us1976"}, {"mach": [1.0]}, {"time_s": 3},
)  # fmt: skip


def files(rng, count, until, tried):
    """Damaged files, each in a tree that names it."""
    with scratch() as folder:
        for number in turns(count, until, tried):
            ending, kind, text = rng.choice(SEEDS)
            data = _damaged(rng, text)
            path = (
                folder / f"{number % 8}{rng.choice((ending, ending, ending, '.csv', '.parquet'))}"
            )
            path.write_bytes(data)
            options = rng.choice(_OPTIONS)
            said = (path.name, kind, options, data[:500])
            tried.look(said, lambda p=path, k=kind, o=options: _read(p.name, k, dict(o), folder))


def _damaged(rng, text):
    for _ in range(rng.choice((0, 1, 1, 2, 3, 8))):
        at = rng.randrange(len(text) + 1)
        way = rng.randrange(4)
        if way == 0:
            text = text[:at] + rng.choice(_PIECES) + text[at:]
        elif way == 1:
            text = text[:at] + text[at + rng.choice((1, 2, 5, 30)) :]
        elif way == 2:
            other = rng.randrange(len(text) + 1)
            text = text[:at] + text[min(at, other) : max(at, other)] + text[at:]
        else:
            text = text[:at] + text[rng.randrange(len(text) + 1) :]
    return text.encode(rng.choice(("utf-8", "utf-8", "latin-1", "utf-16")), errors="replace")


def _read(name, kind, options, folder):
    """Read a file as a campaign does; accepted numbers are finite, and of one length."""
    table = {"file": name} | options
    aero = {"reference_area_m2": 1.0, "reference_length_m": 1.0, "table": table}
    tree = {
        "motor": {"motor": [{"name": "m", "profile": table}]},
        "aero": {"body": {"b": {"aerodynamics": aero}}},
        "air": {"environment": {"air": table}},
        "wind": {"environment": {"wind": {"azimuth_deg": 90.0, "profile": table}}},
    }[kind]
    problems = Problems()
    read_files(tree, Path(folder), problems)
    problems.raise_if_any("fuzz")
    convert_tree(tree, problems)
    problems.raise_if_any("fuzz")
    if kind == "motor" and not math.isfinite(tree["motor"][0].get("thrust_N", 1.0)):
        raise Wrong("a thrust that is not finite was accepted")
    for key, value in table.items():
        if isinstance(value, list) and not _is_finite(value):
            raise Wrong(f"{key} has a number that is not finite")


def _is_finite(value):
    if isinstance(value, list):
        return all(map(_is_finite, value))
    return not isinstance(value, float) or math.isfinite(value)
