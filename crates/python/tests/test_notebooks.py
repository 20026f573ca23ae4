"""Every notebook runs to its end and shows pictures."""

from importlib import import_module
from pathlib import Path
from typing import Any, cast

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[3] / "examples/notebooks").glob("*.ipynb"))


def test_there_are_notebooks() -> None:
    assert len(NOTEBOOKS) == 6


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(notebook: Path, tmp_path: Path) -> None:
    nbformat, nbclient = cast(Any, import_module("nbformat")), cast(Any, import_module("nbclient"))
    book = nbformat.read(notebook, as_version=4)
    nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    pictures = [
        output for cell in book.cells for output in cell.get("outputs", []) if "image/png" in output.get("data", {})
    ]
    assert pictures, "the notebook shows no picture"
