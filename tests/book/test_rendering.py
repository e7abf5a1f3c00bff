"""Pieces of rendering whose failure a whole build would hide."""

from __future__ import annotations

import nbformat
import pytest
from inswsn_book.rendering import (
    RenderingError,
    warnings_in,
    with_captions,
)


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("/a/b.md:3: WARNING: undefined label", True),
        ("WARNING: unknown config value", True),
        ("/a/b.md:3: ERROR: unknown directive", True),
        ("Source Folder: /tmp/ERROR/WARNING/book", False),
        ("copying images... [100%] WARNING.png", False),
    ],
)
def test_what_counts_as_a_warning(line: str, found: bool) -> None:
    assert bool(warnings_in(f"Running Sphinx\n{line}\ndone")) is found


def figure_output(name: str) -> nbformat.NotebookNode:
    words = {"name": name, "caption": f"See {name}.", "alt": f"What {name} shows."}
    return nbformat.v4.new_output(
        "display_data", data={"image/svg+xml": "<svg/>"}, metadata={"inswsn": words}
    )


def test_captions_move_to_the_cell() -> None:
    cell = nbformat.v4.new_code_cell("x", outputs=[figure_output("fig-a")])
    notebook = with_captions(nbformat.v4.new_notebook(cells=[cell]))
    assert notebook.cells[0].metadata["mystnb"] == {
        "image": {"alt": "What fig-a shows."},
        "figure": {"caption": "See fig-a.", "name": "fig-a"},
    }


def test_two_figures_in_a_cell_are_refused() -> None:
    outputs = [figure_output("fig-a"), figure_output("fig-b")]
    cell = nbformat.v4.new_code_cell("x", outputs=outputs)
    with pytest.raises(RenderingError, match="shows 2 figures; a cell shows one"):
        with_captions(nbformat.v4.new_notebook(cells=[cell]))
