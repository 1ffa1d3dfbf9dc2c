"""Compare the rows of shipped campaigns, bit by bit, with those of another checkout that ships them
too; of columns that differ, the largest difference over the largest magnitude.

``python tests/measure/same_rows.py OTHER [--cases 400]``, with OTHER the root of a checkout.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

HERE = Path(__file__).resolve().parents[2]


def rows(root: Path, name: str, cases: int, folder: Path) -> pd.DataFrame:
    """Case table of a campaign that the code under ``root`` simulates."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(root),
        "SEPMC_CACHE_DIR": str(folder / "cache"),
    }
    command = [sys.executable, "-m", "sepmc", "campaign", str(root / "campaigns" / name)]
    command += ["--cases", str(cases), "--no-plots", "--quiet", "--out", str(folder / name)]
    subprocess.run(command, env=environment, check=True, cwd=folder)
    return pd.read_parquet(folder / name / "cases")


def differing(one: pd.DataFrame, other: pd.DataFrame) -> dict[str, float]:
    """Columns of both tables whose values differ in any bit, with their largest difference over the
    largest magnitude; infinite for what is no number, or is NaN in one table only."""
    names = {}
    for column in one.columns.intersection(other.columns):
        a, b = one[column].to_numpy(), other[column].to_numpy()
        same = len(a) == len(b) and (
            np.array_equal(a.view(np.uint64), b.view(np.uint64))
            if a.dtype == np.float64 == b.dtype
            else list(a) == list(b)
        )
        if not same:
            names[column] = np.inf
            are_numbers = a.dtype == np.float64 == b.dtype and len(a) == len(b)
            if are_numbers and np.array_equal(np.isnan(a), np.isnan(b)):
                names[column] = np.nanmax(np.abs(a - b)) / max(np.nanmax(np.abs(b)), 1e-300)
    return names


def main() -> None:
    """Print a line for each campaign; exit with 1 if any row differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", type=Path)
    parser.add_argument("--cases", type=int, default=400)
    arguments = parser.parse_args()
    failed = False
    with tempfile.TemporaryDirectory() as work:
        for file in sorted((HERE / "campaigns").glob("*.toml")):
            if not (arguments.other / "campaigns" / file.name).exists():
                continue
            tables = []
            for k, root in enumerate((HERE, arguments.other.resolve())):
                folder = Path(work) / str(k)
                folder.mkdir(exist_ok=True)
                tables.append(rows(root, file.name, arguments.cases, folder))
            columns = differing(*tables)
            missing = sorted(set(tables[0].columns) ^ set(tables[1].columns))
            failed |= bool(columns or missing)
            said = sorted(columns.items(), key=lambda item: -item[1])
            print(
                f"{file.stem}: "
                + ("; ".join(f"{name} {size:.1e}" for name, size in said) or "same bits")
                + (f"; in one table only: {', '.join(missing)}" if missing else ""),
                flush=True,
            )
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
