"""Where a reader can run the chapters: addresses, the page's text, the line on chapters, Binder."""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
import tomllib
from pathlib import Path
from urllib.parse import unquote, urlsplit

import nbformat
import pytest
from bs4 import BeautifulSoup
from conftest import MiniProject, run_command
from hypothesis import given
from hypothesis import strategies as st
from inswsn_book.about import About, load_about
from inswsn_book.binder import binder_files, stale_binder_files
from inswsn_book.environment import PYTHON
from inswsn_book.launch_links import launch_setting, with_links
from inswsn_book.launching import colab_cell, launch_addresses, launch_text
from inswsn_book.project import Project

REPOSITORY = "https://github.com/someone/some-name"


def about_at(root: Path, repository: str | None, version: str = "1.2.3") -> About:
    return load_about(root).model_copy(update={"repository": repository, "version": version})


# The forms that mybinder.org and Colab document.
@pytest.mark.parametrize(
    ("repository", "addresses"),
    [
        (None, {}),
        (
            REPOSITORY,
            {
                "Binder": "https://mybinder.org/v2/gh/someone/some-name/v1.2.3"
                "?labpath=chapters%2F00-a.ipynb",
                "Colab": "https://colab.research.google.com/github/someone/some-name/"
                "blob/v1.2.3/chapters/00-a.ipynb",
            },
        ),
        (
            "https://gitlab.com/someone/some-name",
            {
                "Binder": "https://mybinder.org/v2/gl/someone%2Fsome-name/v1.2.3"
                "?labpath=chapters%2F00-a.ipynb"
            },
        ),
        (
            "https://git.example.org/someone/some-name",
            {
                "Binder": "https://mybinder.org/v2/git/"
                "https%3A%2F%2Fgit.example.org%2Fsomeone%2Fsome-name/v1.2.3"
                "?labpath=chapters%2F00-a.ipynb"
            },
        ),
    ],
)
def test_the_addresses(root: Path, repository: str | None, addresses: dict[str, str]) -> None:
    assert launch_addresses(about_at(root, repository), "chapters/00-a.ipynb") == addresses


@given(
    host=st.sampled_from(["github.com", "gitlab.com", "example.org"]),
    owner=st.from_regex(r"[\w-]{1,9}", fullmatch=True).filter(str.isascii),
    name=st.from_regex(r"[\w.-]{0,8}\w", fullmatch=True).filter(str.isascii),
)
def test_an_address_holds_repository_tag_and_notebook(
    root: Path, host: str, owner: str, name: str
) -> None:
    about = about_at(root, f"https://{host}/{owner}/{name}")
    for service, address in launch_addresses(about, "chapters/00-a.ipynb").items():
        parts = urlsplit(address)
        plain = unquote(f"{parts.path}?{parts.query}").removesuffix("?")
        assert parts.scheme == "https"
        assert f"{owner}/{name}/" in plain, service
        assert "/v1.2.3" in plain
        assert plain.endswith("chapters/00-a.ipynb")


def test_without_a_repository_the_page_has_one_sentence_and_no_link(project: Project) -> None:
    text = launch_text(about_at(project.root, None), project.chapters())
    assert text.count(".\n") == 1
    assert "not set" in text
    assert "](" not in text
    assert "http" not in text
    assert "{doc}" not in text


def test_with_a_repository_the_page_has_links_for_each_chapter(project: Project) -> None:
    chapters = project.chapters()
    text = launch_text(about_at(project.root, REPOSITORY), chapters)
    opened = re.findall(r"chapters(?:/|%2F)(\d\d-[a-z0-9-]+)\.ipynb\)", text)
    assert sorted(opened) == sorted(2 * [chapter.name for chapter in chapters])
    assert "not set" not in text
    assert colab_cell(about_at(project.root, REPOSITORY)) in text


def test_another_host_has_no_colab(project: Project) -> None:
    text = launch_text(about_at(project.root, "https://gitlab.com/a/b"), project.chapters())
    assert "mybinder.org/v2/gl/a%2Fb/" in text
    assert "colab.research" not in text
    assert "!git clone" not in text


def test_the_notebooks_that_links_open_are_kept(project: Project) -> None:
    """A twin is a notebook without outputs, at the place that the links name."""
    for chapter in project.chapters():
        path = project.root / f"chapters/{chapter.twin.name}"
        assert nbformat.read(path, as_version=4).cells


def test_the_cell_for_colab_does_what_it_says(project: Project, tmp_path: Path) -> None:
    """It clones the tag into the folder that it then enters, below what pip is to install."""
    origin = tmp_path / "origin"
    (origin / "chapters").mkdir(parents=True)
    for name in ("pyproject.toml", "chapters/00-a.ipynb"):
        (origin / name).write_text("[project]\n")
    git = ["git", "-C", str(origin), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "first"], ["tag", "v1.2.3"]):
        subprocess.run([*git, *words], check=True)
    clone, enter, install = colab_cell(about_at(project.root, origin.as_uri())).splitlines()
    quiet = clone.removeprefix("!").split()
    subprocess.run(quiet, check=True, cwd=tmp_path, capture_output=True)
    folder = tmp_path / enter.removeprefix("%cd ")
    assert (folder / "00-a.ipynb").is_file()
    assert install.split()[:4] == ["%pip", "install", "--quiet", ".."]
    assert (folder / ".." / "pyproject.toml").is_file()


def test_the_comparison_that_the_page_gives_for_colab(project: Project) -> None:
    """It runs by the library of the checkout, whatever pip has installed beside it."""
    text = launch_text(about_at(project.root, REPOSITORY), project.chapters())
    found = re.search(r"^!cd \.\. && python (.*) results/02\.json$", text, re.MULTILINE)
    assert found is not None
    words = [*found[1].split(), "data/published/02.json"]
    done = subprocess.run(
        [sys.executable, *words], cwd=project.root, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"^0 of [1-9]\d* quantities changed", done.stdout, re.MULTILINE)


def test_what_the_library_imports_is_installed_with_it(root: Path) -> None:
    """Elsewhere than in the locked environment, as in Colab, pyproject.toml says what is needed."""
    import_names = {"scikit-learn": "sklearn", "pyyaml": "yaml", "python-ins": "pyins"}
    import_names |= {"beautifulsoup4": "bs4", "ipython": "IPython"}
    listed = tomllib.loads((root / "pyproject.toml").read_text())["project"]["dependencies"]
    names = {re.split(r"[<>=\[;]", need)[0] for need in listed}
    there = {import_names.get(name, name).replace("-", "_") for name in names}
    # torch has a lock and an index of its own, so the cell names it
    assert colab_cell(about_at(root, REPOSITORY)).endswith(" .. torch")
    there.add("torch")
    used: set[str] = set()
    for path in (root / "inswsn_lib").rglob("*.py"):
        used |= set(re.findall(r"^\s*(?:from|import) (\w+)", path.read_text(), re.MULTILINE))
    assert used & {"sklearn", "scipy", "cvxpy", "pyins", "torch"} <= there


def test_links_go_below_the_title_and_are_escaped() -> None:
    body = "<section><h1>One</h1><p>Text.</p><h1>Two</h1></section>"
    made = with_links(body, {"A<b": "https://a.example/?x=1&y=2"}, "../launch.html")
    soup = BeautifulSoup(made, "html.parser")
    line = soup.find_all("p")[0]
    assert line["class"] == ["launch"]
    assert line.find_previous_sibling().get_text() == "One"
    assert [a["href"] for a in line.find_all("a")] == [
        "https://a.example/?x=1&y=2",
        "../launch.html",
    ]
    assert line.find("a").get_text() == "A<b"
    assert made.count('class="launch"') == 1


def with_launch_page(mini: MiniProject, root: Path) -> None:
    """Give the small project the book's own pages on running it and on its state."""
    book = mini.root / "book"
    for name in ("launch.md", "status.md"):
        shutil.copy(root / "book" / name, book / name)
    (book / "reproduce.md").write_text(
        "# Reproduce\n\n## Without make\n\nDo this.\n\nOn Windows, that.\n"
    )
    pages = "".join(f"  - file: {name}\n" for name in ("launch", "status", "reproduce"))
    toc = book / "_toc.yml"
    toc.write_text(toc.read_text() + pages)


def set_repository(mini: MiniProject, address: str) -> None:
    path = mini.root / "data" / "about.yaml"
    text, found = re.subn(
        r"^repository: .*$", f"repository: {address}", path.read_text(), flags=re.M
    )
    assert found == 1
    path.write_text(text)


def foreign_links(page: Path) -> list[str]:
    soup = BeautifulSoup(page.read_text(encoding="utf-8"), "html.parser")
    return [str(a["href"]) for a in soup.select(".launch a, article a") if "//" in str(a["href"])]


@pytest.mark.long
def test_the_rendered_pages_with_and_without_a_repository(built: MiniProject, root: Path) -> None:
    """One build after the other, on the book's own configuration and theme."""
    with_launch_page(built, root)
    set_repository(built, "null")
    done = run_command(built.root, "book")
    assert done.returncode == 0, done.stderr
    chapter, page = built.site / "chapters" / "00-mini.html", built.site / "launch.html"
    assert 'class="launch"' not in chapter.read_text(encoding="utf-8")
    assert "not set" in page.read_text(encoding="utf-8")
    for path in built.site.rglob("*.html"):
        assert not re.search(r"mybinder|colab\.research", path.read_text(encoding="utf-8"))

    set_repository(built, REPOSITORY)
    done = run_command(built.root, "book")
    assert done.returncode == 0, done.stderr  # and with it the inspection: nothing from elsewhere
    wanted = launch_addresses(load_about(built.root), "chapters/00-mini.ipynb")
    assert [to for to in foreign_links(chapter) if to in wanted.values()] == list(wanted.values())
    soup = BeautifulSoup(chapter.read_text(encoding="utf-8"), "html.parser")
    line = soup.select_one("article .launch")
    assert line is not None
    assert line.find_previous_sibling("h1") is not None
    assert line.find_all("a")[-1]["href"] == "../launch.html"
    assert set(wanted.values()) <= set(foreign_links(page))
    # a page that is no chapter has no such line
    assert 'class="launch"' not in page.read_text(encoding="utf-8")


def test_the_setting_that_the_renderer_hands_over(mini: MiniProject) -> None:
    set_repository(mini, "null")
    assert launch_setting(mini) == "{}"
    set_repository(mini, REPOSITORY)
    assert list(json.loads(launch_setting(mini))) == ["chapters/00-mini"]


def test_the_files_of_binder_are_up_to_date(project: Project) -> None:
    assert stale_binder_files(project) == []
    assert (project.root / "binder/postBuild").stat().st_mode & stat.S_IXUSR


def test_binder_has_the_python_of_the_locks(root: Path) -> None:
    makefile = (root / "Makefile").read_text()
    assert binder_files()["binder/runtime.txt"] == f"python-{PYTHON}\n"
    major, minor = PYTHON.split(".")
    assert f"v == ({major}, {minor})" in makefile


def test_stale_files_of_binder_are_told_and_written(mini: MiniProject) -> None:
    done = run_command(mini.root, "binder", "--check")
    assert done.returncode == 2
    assert "binder/runtime.txt, binder/postBuild" in done.stderr
    assert run_command(mini.root, "binder").returncode == 0
    assert os.access(mini.root / "binder/postBuild", os.X_OK)
    assert run_command(mini.root, "binder", "--check").returncode == 0
    (mini.root / "binder/runtime.txt").write_text("python-3.9\n")
    done = run_command(mini.root, "binder", "--check")
    assert done.returncode == 2
    assert "binder/postBuild" not in done.stderr


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
    script = root / "binder/postBuild"
    subprocess.run(["bash", str(script)], cwd=tmp_path, env=environment, check=True)
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
