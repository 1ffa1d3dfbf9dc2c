"""Every notebook runs from top to bottom."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))


def test_there_are_seven():
    assert [path.stem for path in NOTEBOOKS] == [
        "flight-data",
        "reconstruction",
        "sensitivity",
        "single_run",
        "size",
        "table2",
        "verdict",
    ]


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # the client's own libraries warn about event loops
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path):
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook,
        timeout=600,
        kernel_name="python3",
        resources={"metadata": {"path": str(path.parent)}},
    ).execute()
