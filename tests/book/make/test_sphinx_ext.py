"""Where a reader can run the chapters: the theme's buttons, the page's text, Binder's script."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from bs4 import BeautifulSoup
from conftest import REPOSITORY, MiniProject, Render, git
from docutils import nodes
from docutils.utils import new_document
from inswsn_book.make import sphinx_ext
from inswsn_book.record.project import Project
from sphinx import addnodes


@pytest.fixture
def launch(render: Render, known: dict[str, Any]) -> Callable[[str | None], str]:
    """The page on where to run a chapter, of version 1.2.3 at some address."""

    def page(repository: str | None) -> str:
        about = known["about"] | {"repository-code": repository, "version": "1.2.3"}
        return re.split(r"\n## ", render("reproduce", about=about).split("\n## Online")[1])[0]

    return page


# The buttons -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("repository", "services"),
    [
        (None, []),
        (REPOSITORY, ["binderhub_url", "colab_url"]),
        ("https://gitlab.com/someone/some-name", ["binderhub_url"]),
        ("https://git.example.org/someone/some-name", []),  # of which the theme knows nothing
    ],
)
def test_the_buttons_that_the_theme_is_asked_for(
    mini: MiniProject, monkeypatch: pytest.MonkeyPatch, repository: str | None, services: list[str]
) -> None:
    about = mini.about() | {"repository-code": repository}
    monkeypatch.setattr(Project, "about", lambda _: about)
    monkeypatch.chdir(mini.root)
    mini.ledger.write_text("missing: {}\nclaims: []\n")
    config: Any = SimpleNamespace(html_theme_options={}, html_extra_path=[])
    sphinx_ext._configure(SimpleNamespace(srcdir=mini.root / "book"), config)
    asked = config.html_theme_options.get("launch_buttons", {})
    assert [name for name in asked if name.endswith("_url") and asked[name]] == services
    assert config.project == about["title"]


def test_the_rendered_pages_with_a_repository(built_mini: Path, released_mini: Path) -> None:
    """On the book's own configuration and theme: what its buttons open is the chapter's twin."""
    for path in (built_mini / "_build" / "html").rglob("*.html"):  # without a repository
        assert not re.search(r"mybinder|colab\.research", path.read_text(encoding="utf-8"))
    site = released_mini / "_build" / "html"
    page = (site / "chapters" / "00-mini.html").read_text(encoding="utf-8")
    links = {str(a["href"]) for a in BeautifulSoup(page, "html.parser").find_all("a", href=True)}
    tag = f"v{Project(released_mini).about()['version']}"
    (binder,) = (urlsplit(link) for link in links if "mybinder" in link)
    assert binder.path == f"/v2/gh/someone/some-name/{tag}"
    assert parse_qs(binder.query) == {"urlpath": ["lab/tree/chapters/00-mini.ipynb"]}
    (colab,) = (link for link in links if "colab" in link)
    assert colab.endswith(f"/github/someone/some-name/blob/{tag}/chapters/00-mini.ipynb")
    # a page that is no chapter has none; every page says what it was built from
    page = (site / "index.html").read_text(encoding="utf-8")
    assert "mybinder" not in page
    head = git(released_mini, "rev-parse", "HEAD")
    assert f"Built by inswsn {tag[1:]} from commit {head[:12]}, environment.lock SHA-256" in page


# The page ----------------------------------------------------------------------------------------


def test_the_cell_for_colab_does_what_it_says(launch: Render, tmp_path: Path) -> None:
    """It clones the tag into the folder that it then enters, below what pip is to install."""
    origin = tmp_path / "origin"
    for name in ("pyproject.toml", "book/pyproject.toml", "chapters/00-a.ipynb"):
        (origin / name).parent.mkdir(parents=True, exist_ok=True)
        (origin / name).write_text("[project]\n")
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "first"], ["tag", "v1.2.3"]):
        git(origin, *words)
    text = launch(origin.as_uri())
    cell = text[text.index("!git clone") :].split("\n```")[0].splitlines()
    clone, enter, install = cell
    subprocess.run(clone.removeprefix("!").split(), check=True, cwd=tmp_path, capture_output=True)
    folder = tmp_path / enter.removeprefix("%cd ")
    assert (folder / "00-a.ipynb").is_file()
    assert install.split()[:3] == ["%pip", "install", "--quiet"]
    for package in [word for word in install.split() if word.startswith("..")]:
        assert (folder / package / "pyproject.toml").is_file()


def test_the_comparison_that_the_page_gives_for_colab(launch: Render, root: Path) -> None:
    """It runs by the library of the checkout, whatever pip has installed beside it."""
    assert "http" not in launch(None)  # no address of a repository, and so no cell
    found = re.search(
        r"^!cd \.\. && python (.*) results/p1-training\.json$", launch(REPOSITORY), re.M
    )
    words = [*found[1].split(), "data/published/p1-training.json"]
    done = subprocess.run([sys.executable, *words], cwd=root, capture_output=True, text=True,
                          check=True)  # fmt: skip
    assert re.search(r"^0 of [1-9]\d* quantities changed", done.stdout, re.MULTILINE)


# The reference of the library ---------------------------------------------------------------------


def test_the_words_of_a_shape_are_no_types() -> None:
    """What Sphinx 9 would link to an attribute of any class that has the name."""
    asked = [
        ("class", "runs"),
        ("class", "Scores"),
        ("class", "inswsn_lib.Scores"),
        ("attr", "runs"),
    ]
    tree = new_document("api")
    for kind, target in asked:
        link = addnodes.pending_xref("", nodes.emphasis("", target), reftype=kind, reftarget=target)
        tree += nodes.paragraph("", "", link)
    sphinx_ext._unlink_words(None, tree)
    left = [(link["reftype"], link["reftarget"]) for link in tree.findall(addnodes.pending_xref)]
    assert left == asked[1:]
    assert [words.astext() for words in tree.findall(nodes.emphasis)] == [name for _, name in asked]


# Binder ------------------------------------------------------------------------------------------


def test_binder_has_the_locked_environment_and_its_python(root: Path, tmp_path: Path) -> None:
    """Its script is run with a make and a Python that only tell how they were called."""
    runtime = (root / "binder/runtime.txt").read_text().strip()
    major, minor = runtime.removeprefix("python-").split(".")
    assert f"version == ({major}, {minor})" in (root / ".ci/environment.py").read_text()
    script, told = root / "binder/postBuild", tmp_path / "told"
    assert os.access(script, os.X_OK)
    for path in (tmp_path / "bin/make", tmp_path / ".venv/bin/python"):
        path.parent.mkdir(parents=True)
        path.write_text(f'#!/bin/sh\necho "$(basename "$0") $*" >> "{told}"\n')
        path.chmod(0o755)
    own = {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}", "NB_PYTHON_PREFIX": "/srv/notebook"}
    bash = str(shutil.which("bash"))
    subprocess.run([bash, str(script)], cwd=tmp_path, env=os.environ | own, check=True)
    assert told.read_text().splitlines() == [
        "make environment PYTHON=/srv/notebook/bin/python",
        "python -m ipykernel install --prefix /srv/notebook --name python3",
    ]


def test_symbols_that_a_page_names_are_marked_in_its_code() -> None:
    body = '<section id="a"><span class="n">K</span> <span class="n">Kit</span></section>'
    for meta, marked in (({}, False), ({"symbols": "K nu"}, True)):
        context = {"meta": meta, "body": body}
        sphinx_ext._colour_symbols(None, "", "", context, None)
        assert ('<section data-symbols="K nu" id="a">' in context["body"]) is marked
        assert ('<span class="n symbol-K">K</span>' in context["body"]) is marked
        assert '<span class="n">Kit</span>' in context["body"]
