"""Where a reader can run the chapters: the addresses, and what the page "Run it" says of them."""

from __future__ import annotations

from collections.abc import Sequence
from urllib.parse import quote, urlsplit

from inswsn_book.about import About
from inswsn_book.project import Chapter
from inswsn_book.tables import list_table

_BINDER = "https://mybinder.org/v2"
_COLAB = "https://colab.research.google.com/github"
_GITHUB, _GITLAB = "github.com", "gitlab.com"


def release_tag(about: About) -> str:
    """Return the tag that names this version in the repository: ``"v1.0.0"``."""
    return f"v{about.version}"


def launch_addresses(about: About, notebook: str) -> dict[str, str]:
    """Return the services that open a notebook, by name, with the address that opens it.

    Every address names the release's tag, so that a page opens the notebook that it shows.

    Parameters
    ----------
    about : About
        With the repository's address, on which all of them rest.
    notebook : str
        Where it stands in the repository: ``"chapters/00-name.ipynb"``.

    Returns
    -------
    dict of str to str
        Empty while the repository's address is not set. Colab reads repositories of github.com
        alone, and is left out for another host.
    """
    if about.repository is None:
        return {}
    tag = quote(release_tag(about), safe="")
    parts = urlsplit(about.repository)
    name = parts.path.strip("/")
    found = {
        "Binder": f"{_BINDER}/{_binder_source(about.repository)}/{tag}"
        f"?labpath={quote(notebook, safe='')}"
    }
    if parts.netloc == _GITHUB:
        found["Colab"] = f"{_COLAB}/{name}/blob/{tag}/{quote(notebook)}"
    return found


def _binder_source(repository: str) -> str:
    parts = urlsplit(repository)
    name = parts.path.strip("/")
    if parts.netloc == _GITHUB:
        return f"gh/{name}"
    if parts.netloc == _GITLAB:
        return f"gl/{quote(name, safe='')}"
    return f"git/{quote(repository, safe='')}"


def launch_text(about: About, chapters: Sequence[Chapter]) -> str:
    """Return what the page of launchers says of running online, as MyST Markdown.

    Parameters
    ----------
    about : About
        With the repository's address; while it is not set, the text is one sentence that says so.
    chapters : sequence of Chapter
        In the order of the book.
    """
    if about.repository is None:
        return (
            "There are no online launchers, since the address of the repository is not set "
            "(`repository` in `data/about.yaml`).\n"
        )
    addresses = {
        chapter: launch_addresses(about, f"chapters/{chapter.twin.name}") for chapter in chapters
    }
    services = list(next(iter(addresses.values())))
    lines = [
        f"The links open the notebooks of version {about.version}, tag `{release_tag(about)}` of "
        f"[the repository]({about.repository}). This gives a checkout of it:",
        "",
        "```bash",
        f"git clone --branch {release_tag(about)} {about.repository}",
        "```",
        "",
    ]
    rows = [["chapter", *services]]
    for chapter, found in addresses.items():
        links = [f"[{chapter.number} on {name}]({found[name]})" for name in services]
        rows.append([f"{{doc}}`chapters/{chapter.name}`", *links])
    lines += [list_table("Where each chapter can be opened.", "tbl-launch", rows), _BINDER_TEXT]
    if "Colab" in services:
        lines += [_COLAB_TEXT.replace("@CELL@", colab_cell(about))]
    else:
        lines += ["Colab opens notebooks of github.com alone.\n"]
    return "\n".join(lines)


def colab_cell(about: About) -> str:
    """Return the cell that a chapter needs before all others in Colab.

    Parameters
    ----------
    about : About
        With the repository's address, on github.com.
    """
    return (
        f"!git clone --quiet --depth 1 --branch {release_tag(about)} {about.repository} inswsn\n"
        "%cd inswsn/chapters\n"
        "%pip install --quiet .. torch"
    )


_BINDER_TEXT = """\
### Binder

Binder makes an image of the repository by `binder/postBuild`, which calls `make environment`: the
chapters run in an environment of their own, made from the same locks and for the same Python as
on your machine, and not among the packages of Binder's server. A terminal there has all commands of
{doc}`reproduce`, and `make book` needs no second installation. The first launch of a version makes
the image, which takes many minutes; later ones start from it.

A session has little memory and a share of a processor: expect several times the run times on the
page {doc}`status`, and give the long chapters smaller parameters. What you change there is lost
when the session ends.
"""

_COLAB_TEXT = """\
### Colab

Colab cannot open a `.md` file, so the links open the notebooks that are made from the sources,
`chapters/NN-name.ipynb`. It takes the notebook and nothing else of the repository. Put this into a
new first cell, run it, and then the chapter:

```text
@CELL@
```

Colab has a Python and packages of its own, and they change. The cell adds what is missing and
keeps what is new enough, so the locks do not hold. What still holds: each chapter checks every
sentence that rests on a result and stops at the first that its numbers do not bear out, and its
verdicts follow from its own numbers. Its numbers may differ from the published ones, in the last
digits or, where a solver or a random generator has changed, by more. The last cell of a chapter
writes `../results/NN.json`. With `02` in the place of `NN`,

```text
!cd .. && python -m inswsn_book compare data/published/02.json results/02.json
```

shows each number beside the published one and names the verdicts that differ. Where the numbers
must be those of the locks, use Binder or your own machine.
"""
