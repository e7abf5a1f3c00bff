"""Where a reader can run the chapters: the theme's buttons, the page's text, Binder's script."""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import parse_qs, urlsplit

import nbformat
import pytest
from bs4 import BeautifulSoup
from conftest import MiniProject, run_command
from inswsn_book import sphinx_ext
from inswsn_book.pages import environment
from inswsn_book.project import Project

REPOSITORY = "https://github.com/someone/some-name"


def launch_page(project: Project, repository: str | None) -> str:
    about = project.about() | {"repository-code": repository, "version": "1.2.3"}
    return environment(project.root).get_template("launch.md").render(about=about)


def colab_cell(project: Project, repository: str) -> list[str]:
    text = launch_page(project, repository)
    return text[text.index("!git clone") :].split("\n```")[0].splitlines()


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
    mini: Project, monkeypatch: pytest.MonkeyPatch, repository: str | None, services: list[str]
) -> None:
    about = mini.about() | {"repository-code": repository}
    monkeypatch.setattr(Project, "about", lambda _: about)
    monkeypatch.chdir(mini.root)
    (mini.root / "data/claims/mini.yaml").write_text("missing: {}\nclaims: []\n")
    config: Any = SimpleNamespace(html_theme_options={})
    sphinx_ext._configure(SimpleNamespace(srcdir=mini.root / "book"), config)
    asked = config.html_theme_options.get("launch_buttons", {})
    assert [name for name in asked if name.endswith("_url") and asked[name]] == services
    assert config.project == about["title"]


def test_the_page_of_launchers(project: Project) -> None:
    text = launch_page(project, None).split("## Online")[1]
    assert "not name the address" in text
    assert "http" not in text
    text = launch_page(project, REPOSITORY).split("## Online")[1]
    assert f"git clone --branch v1.2.3 {REPOSITORY}\n" in text


def test_the_notebooks_that_buttons_open_are_kept(project: Project) -> None:
    """A twin is a notebook without outputs, at the place that the buttons name."""
    for chapter in project.chapters():
        assert nbformat.read(project.root / f"chapters/{chapter.twin.name}", as_version=4).cells


def test_the_cell_for_colab_does_what_it_says(project: Project, tmp_path: Path) -> None:
    """It clones the tag into the folder that it then enters, below what pip is to install."""
    origin = tmp_path / "origin"
    for name in ("pyproject.toml", "book/pyproject.toml", "chapters/00-a.ipynb"):
        (origin / name).parent.mkdir(parents=True, exist_ok=True)
        (origin / name).write_text("[project]\n")
    git = ["git", "-C", str(origin), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "first"], ["tag", "v1.2.3"]):
        subprocess.run([*git, *words], check=True)
    clone, enter, install = colab_cell(project, origin.as_uri())
    subprocess.run(clone.removeprefix("!").split(), check=True, cwd=tmp_path, capture_output=True)
    folder = tmp_path / enter.removeprefix("%cd ")
    assert (folder / "00-a.ipynb").is_file()
    assert install.split()[:3] == ["%pip", "install", "--quiet"]
    for package in [word for word in install.split() if word.startswith("..")]:
        assert (folder / package / "pyproject.toml").is_file()


def test_the_comparison_that_the_page_gives_for_colab(project: Project) -> None:
    """It runs by the library of the checkout, whatever pip has installed beside it."""
    text = launch_page(project, REPOSITORY)
    found = re.search(r"^!cd \.\. && python (.*) results/02\.json$", text, re.MULTILINE)
    assert found is not None
    words = [*found[1].split(), "data/published/02.json"]
    done = subprocess.run(
        [sys.executable, *words], cwd=project.root, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"^0 of [1-9]\d* quantities changed", done.stdout, re.MULTILINE)


@pytest.mark.long
def test_the_rendered_pages_with_a_repository(built: MiniProject) -> None:
    """On the book's own configuration and theme: what its buttons open is the chapter's twin."""
    for path in built.site.rglob("*.html"):  # of a book whose repository is not set
        assert not re.search(r"mybinder|colab\.research", path.read_text(encoding="utf-8"))
    with (built.root / "CITATION.cff").open("a", encoding="utf-8") as file:
        file.write(f"repository-code: {REPOSITORY}\n")
    done = run_command(built.root, "book")
    assert done.returncode == 0, done.stderr  # and with it the inspection: nothing from elsewhere
    page = (built.site / "chapters" / "00-mini.html").read_text(encoding="utf-8")
    links = {str(a["href"]) for a in BeautifulSoup(page, "html.parser").find_all("a", href=True)}
    tag = f"v{built.about()['version']}"
    (binder,) = (urlsplit(link) for link in links if "mybinder" in link)
    assert binder.path == f"/v2/gh/someone/some-name/{tag}"
    assert parse_qs(binder.query) == {"urlpath": ["lab/tree/chapters/00-mini.ipynb"]}
    (colab,) = (link for link in links if "colab" in link)
    assert colab.endswith(f"/github/someone/some-name/blob/{tag}/chapters/00-mini.ipynb")
    # a page that is no chapter has none
    assert "mybinder" not in (built.site / "index.html").read_text(encoding="utf-8")


def test_binder_has_the_python_of_the_locks(root: Path) -> None:
    runtime = (root / "binder/runtime.txt").read_text()
    major, minor = runtime.removeprefix("python-").strip().split(".")
    assert f"v == ({major}, {minor})" in (root / "Makefile").read_text()
    assert (root / "binder/postBuild").stat().st_mode & stat.S_IXUSR


def test_the_script_of_binder_gives_the_server_the_locked_kernel(
    root: Path, tmp_path: Path
) -> None:
    """Run with a make and a Python that only tell how they were called."""
    told = tmp_path / "told"
    (tmp_path / "bin").mkdir()
    (tmp_path / ".venv/bin").mkdir(parents=True)
    for path in (tmp_path / "bin/make", tmp_path / ".venv/bin/python"):
        path.write_text(f'#!/bin/sh\necho "$(basename "$0") $*" >> "{told}"\n')
        path.chmod(0o755)
    environment = os.environ | {
        "PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}",
        "NB_PYTHON_PREFIX": "/srv/conda/envs/notebook",
    }
    subprocess.run(
        [str(shutil.which("bash")), str(root / "binder/postBuild")],
        cwd=tmp_path,
        env=environment,
        check=True,
    )
    assert told.read_text().splitlines() == [
        "make environment PYTHON=/srv/conda/envs/notebook/bin/python",
        "python -m ipykernel install --prefix /srv/conda/envs/notebook --name python3",
    ]


def test_the_kernel_of_the_server_is_replaced(tmp_path: Path) -> None:
    """ipykernel writes over a kernel of that name, as the script of Binder and the page rely on."""
    kernel = tmp_path / "share/jupyter/kernels/python3/kernel.json"
    kernel.parent.mkdir(parents=True)
    kernel.write_text(json.dumps({"argv": ["other", "{connection_file}"], "language": "python"}))
    words = ["-m", "ipykernel", "install", "--prefix", str(tmp_path), "--name", "python3"]
    subprocess.run([sys.executable, *words], check=True, capture_output=True)
    assert json.loads(kernel.read_text())["argv"][0] == sys.executable
