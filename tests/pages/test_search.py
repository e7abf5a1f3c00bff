"""A search leads to the page that teaches what is looked for, among its first three results."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import yaml
from bs4 import BeautifulSoup
from conftest import PATIENCE, ROOT, WHOLE
from inswsn_book.judge.ledger import LEDGER, load_claims
from inswsn_book.record.project import Project
from visiting import Open

pytestmark = pytest.mark.page

# what is looked for, and the number of the chapter that is wanted
WANTED = {
    "LMI": "3", "H-infinity filter": "3", "covariance": "2", "innovation": "2", "outage": "4",
    "LS-SVM": "4", "federated": "5", "EKF": "6", "csv": "your-own-data",
    "which filter": "which-filter",
}  # fmt: skip


def glossary(site: Path) -> dict[str, str]:
    """Return the first name of each entry, and the first lesson that links to it, or the entry."""
    soup = BeautifulSoup((site / "notation.html").read_text(encoding="utf-8"), "html.parser")
    terms = {str(dt["id"]): dt.get_text().rstrip("#") for dt in soup.select("dl.glossary dt[id]")}
    toc = yaml.safe_load((ROOT / "book" / "_toc.yml").read_text(encoding="utf-8"))
    lessons = [f"{chapter['file']}.html" for chapter in toc["parts"][0]["chapters"]]
    assert toc["parts"][0]["caption"] == "Lessons"
    pages = {name: (site / name).read_text(encoding="utf-8") for name in lessons}
    return {
        name.split(", ")[0]: next((p for p in lessons if f'notation.html#{place}"' in pages[p]),
                                  f"notation.html#{place}")
        for place, name in terms.items()
    }  # fmt: skip


def test_what_is_looked_for_is_among_the_first_three(
    served: str, open_page: Open, built_site: Path, project: Project
) -> None:
    """Daily some words are looked for, drawn by a seed; weekly all that are wanted."""
    draw, explained = random.Random(2026), glossary(built_site)
    asked = WANTED if WHOLE else draw.sample(sorted(WANTED), 1)
    wanted = {w: f"chapters/{project.find(WANTED[w]).name}.html" for w in asked}
    claim = draw.choice(load_claims(project.root / LEDGER))
    wanted[claim.id] = f"claims.html#{claim.anchor}"
    words = draw.sample(sorted(explained.keys() - WANTED.keys()), 9 if WHOLE else 1)
    page = open_page("search.html").page
    missed = {}
    for word, place in (wanted | {word: explained[word] for word in words}).items():
        page.goto(f"{served}search.html?q={word}")
        page.wait_for_function(
            "document.querySelector('.search-summary')?.textContent"
            " || document.querySelectorAll('ul.search > li').length > 2", timeout=PATIENCE,
        )  # fmt: skip
        links = page.locator("ul.search > li > a").evaluate_all("(all) => all.map((a) => a.href)")
        found = [link.removeprefix(served) for link in links[:3]]
        if place.startswith("claims"):  # the entry itself, by a mark of the index within it
            ids = page.goto(served + found[0]) and page.evaluate(
                "document.querySelector(':target').closest('.claim').id"
            )
            found = [f"claims.html#{ids}"]
        if not any(link.startswith(place) for link in found):
            missed[word] = place, found
    assert missed == {}
