"""The way out: the settings of plain Sphinx, what it renders, and how that is compared."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import pytest
from inswsn_book.make.site import FOOTER
from jupyter_book.config import get_final_config

#: What Jupyter Book sets beside. No page depends on it: the extension sets titles and authors,
#: nothing is executed, LaTeX is not written, and what is assembled holds no file to be left out.
NOT_NEEDED = {
    *("author", "copyright", "html_title", "html_logo", "html_baseurl", "pygments_style"),
    *("nb_execution_allow_errors", "nb_execution_cache_path", "nb_execution_excludepatterns"),
    *("nb_execution_in_temp", "nb_execution_timeout", "nb_output_stderr", "exclude_patterns"),
    *("latex_engine", "use_jupyterbook_latex", "use_multitoc_numbering", "comments_config"),
    *("suppress_warnings", "myst_url_schemes"),
}
NO_EXTENSIONS = {
    *("jupyter_book", "sphinx_comments", "sphinx_jupyterbook_latex", "sphinx_multitoc_numbering")
}
_WITHOUT = """
import sys
sys.modules["jupyter_book"] = None  # to import it fails
from sphinx.cmd.build import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def settings(root: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What plain Sphinx is told."""
    monkeypatch.chdir(root)
    return runpy.run_path(str(root / "book" / "conf.py"))


def test_the_settings_are_those_of_jupyter_book(root: Path, settings: dict[str, Any]) -> None:
    asked, _ = get_final_config(
        user_yaml=root / "_config.yml", cli_config={"latex_individualpages": False},
        sourcedir=root / "book",
    )  # fmt: skip
    assert asked.keys() - settings.keys() == NOT_NEEDED
    for name in ("html_static_path", "html_css_files", "html_js_files"):
        assert set(asked.pop(name)) == set(settings[name])  # it finds each file once more
    assert [name for name in asked.pop("extensions") if name not in NO_EXTENSIONS] == settings[
        "extensions"
    ]
    assert settings["html_theme_options"].pop("extra_footer").startswith("Built by inswsn")
    assert {name: settings[name] for name in asked.keys() - NOT_NEEDED} == {
        name: value for name, value in asked.items() if name not in NOT_NEEDED
    }


def test_each_extension_is_installed_for_it(root: Path, settings: dict[str, Any]) -> None:
    """One that is not would be taken from the lock, and is then not the newest."""
    lines = (root / ".ci" / "sphinx.in").read_text("utf-8").splitlines()
    asked, known = {line for line in lines if not line.startswith("#")}, packages_distributions()
    assert {re.sub("[._]", "-", name).lower() for name in asked} == asked
    modules = {name.partition(".")[0] for name in settings["extensions"]} - {"inswsn_book"}
    modules = modules - {"sphinxcontrib"} | {"sphinxcontrib.bibtex"}  # many packages share it
    wanted = {re.sub("[._]", "-", known.get(m, [m])[0]).lower() for m in modules}
    assert asked == wanted | {"linkify-it-py"}  # which myst-nb imports on demand


def test_plain_sphinx_renders_the_same(root: Path, built_mini: Path, tmp_path: Path) -> None:
    """By the Sphinx of the environment; the newest is the weekly run's, on the whole book."""
    words = ["-q", "-W", "--keep-going", "-b", "html", "-d", str(tmp_path / "doctrees")]
    folders = [str(built_mini / "_build" / "pages" / "source"), str(tmp_path / "html")]
    done = subprocess.run(
        [sys.executable, "-c", _WITHOUT, *words, *folders],
        cwd=built_mini, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    compare = runpy.run_path(str(root / ".ci" / "same_pages.py"))
    site = built_mini / "_build" / "html"
    assert {"index.html", "claims.html", "chapters/00-mini.html"} <= compare["pages"](site).keys()
    assert compare["differences"](site, tmp_path / "html") == []
    text = (tmp_path / "html" / "index.html").read_text(encoding="utf-8")
    assert FOOTER not in text
    assert "Built by inswsn" in text


PAGE = (
    '<main>Search<article class="bd-article"><h1>On drift</h1>'
    '<figure><img src="a.svg"/></figure> <a class="reference internal" href="b.html">See</a>'
    "</article></main>"
)


@pytest.mark.parametrize(
    ("name", "change", "found"),
    [
        ("index.html", ("", ""), []),
        ("index.html", ("Search", "Find"), []),  # the theme's word
        ("index.html", ("</h1>", "</h1>\n "), []),
        ("api.html", ("drift", "drifts"), []),  # Sphinx wrote it
        ("index.html", ("drift", "{term}`drift`"), ["index.html: …'OndriftSee' and …'On{term}"]),
        ("index.html", ("See", "See p. 2"), ["index.html: …'OndriftSee' and …'OndriftSeep.2'"]),
        ("api.html", ("<img", "<span"), ["api.html: 1 and 0 of <img"]),
        ("api.html", ("a class", "span class"), ["api.html: 1 and 0 of <a"]),
        ("index.html", None, ["index.html: in one of them alone"]),
        ("_static/webpack.html", None, []),
    ],
)
def test_what_differs_between_two_sites(
    root: Path, tmp_path: Path, name: str, change: tuple[str, str] | None, found: list[str]
) -> None:
    for site, text in (("a", PAGE), ("b", None if change is None else PAGE.replace(*change))):
        page = tmp_path / site / name
        page.parent.mkdir(parents=True)
        if text is not None:
            page.write_text(text, encoding="utf-8")
    script = root / ".ci" / "same_pages.py"
    told = runpy.run_path(str(script))["differences"](tmp_path / "a", tmp_path / "b")
    assert len(told) == len(found)
    assert all(line.startswith(start) for line, start in zip(told, found, strict=True))
    words = [sys.executable, str(script), str(tmp_path / "a"), str(tmp_path / "b")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.splitlines()) == (int(bool(found)), told)
