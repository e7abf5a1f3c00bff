"""What a package page shows: README.md with links that lead somewhere, authors and addresses.

It reads CITATION.cff without a package of YAML, since one that builds a wheel has none.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:)([^)\s]+)\)")


def page(readme: str, repository: str, version: str) -> str:
    """Return a README whose links and pictures lead into a repository.

    Where that has no address, the words of a link stay, and a picture becomes what it shows.
    """
    folders = {"": "blob", "!": "raw"}

    def led(link: re.Match[str]) -> str:
        mark, words, path = link.groups()
        return f"{mark}[{words}]({repository}/{folders[mark]}/v{version}/{path})"

    return _LINK.sub(led if repository else r"\2", readme)


def addresses(citation: str) -> dict[str, str]:
    """Return the repository that a CITATION.cff names, and the papers of its references."""
    papers = re.findall(r"^  doi: (\S+)\n  notes: .* (P\d)\.$", citation, re.M)
    urls = {name: f"https://doi.org/{doi}" for doi, name in papers}
    if own := re.search(r"^repository-code: (\S+)", citation, re.M):
        urls["Repository"] = own[1].strip("'\"")
    return urls


def authors(citation: str) -> list[dict[str, str]]:
    """Return whom a CITATION.cff names as authors."""
    (block,) = re.findall(r"^authors:\n((?:[- ] .*\n)+)", citation, re.M)
    people = [
        dict(re.findall(r"([\w-]+): (.+)", each)) for each in re.split("^- ", block, flags=re.M)
    ]
    parts = [(p.get("given-names"), p.get("family-names"), p.get("name")) for p in people[1:]]
    return [{"name": " ".join(filter(None, names))} for names in parts]


class PackagePage(MetadataHookInterface):
    """Sets readme, authors and urls of either package."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Fill what pyproject.toml says is dynamic."""
        here = Path(self.root)
        root = here if (here / "CITATION.cff").exists() else here.parent
        citation = (root / "CITATION.cff").read_text(encoding="utf-8")
        urls = addresses(citation)
        readme = (root / "README.md").read_text(encoding="utf-8")
        text = page(readme, urls.get("Repository", ""), metadata["version"])
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        metadata["urls"], metadata["authors"] = urls, authors(citation)
