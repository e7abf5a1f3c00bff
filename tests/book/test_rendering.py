"""Pieces of rendering whose failure a whole build would hide."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from inswsn_book.rendering import (
    RenderingError,
    restore_site,
    swap_folder,
    warnings_in,
    with_captions,
)


@pytest.fixture
def sites(tmp_path: Path) -> tuple[Path, Path]:
    """A new site and the place of the old one."""
    new, site = tmp_path / "new", tmp_path / "html"
    for folder, text in ((new, "new"), (site, "old")):
        folder.mkdir()
        (folder / "index.html").write_text(text)
    return new, site


def test_a_swap(sites: tuple[Path, Path]) -> None:
    new, site = sites
    swap_folder(new, site)
    assert (site / "index.html").read_text() == "new"
    assert [path.name for path in site.parent.iterdir()] == ["html"]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_a_swap_that_is_cut_short_puts_the_old_site_back(
    sites: tuple[Path, Path], error: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    new, site = sites
    rename = Path.rename

    def cut_short(path: Path, target: Path) -> Path:
        if path == new:
            raise error
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", cut_short)
    with pytest.raises(error):
        swap_folder(new, site)
    assert (site / "index.html").read_text() == "old"


def test_a_swap_that_was_killed_is_undone_by_the_next_build(sites: tuple[Path, Path]) -> None:
    _, site = sites
    site.rename(site.with_name(".html.inswsn-set-aside"))
    for _ in range(2):  # the second time there is nothing to undo
        restore_site(site)
        assert (site / "index.html").read_text() == "old"


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
