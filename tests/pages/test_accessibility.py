"""Every page for readers who do not see it, have no mouse, or have a small screen.

axe-core looks at each page of the book. What it cannot know is checked beside it: that an
alternative text holds numbers of the run, that each table has headers and a name, that text never
needs sideways scrolling, that the keyboard can do what the mouse can.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from bs4 import BeautifulSoup, Tag
from playwright.sync_api import Browser, Page
from visiting import page_names, visit

from inswsn_lib.artefact.accessibility import (
    AXE_TAGS,
    SCREENS,
    accessibility_text,
    axe_script,
    axe_version,
    count_pages,
    count_rules,
)
from inswsn_lib.artefact.project import Project
from inswsn_lib.plotting import COLOURS

pytestmark = pytest.mark.page

ROOT = Path(__file__).resolve().parents[2]


def listed_pages() -> list[str]:
    """Return the pages of the table of contents, and those that Sphinx adds."""
    toc = (ROOT / "book" / "_toc.yml").read_text(encoding="utf-8")
    names = re.findall(r"^\s*-?\s*(?:root|file): (\S+)", toc, re.MULTILINE)
    return sorted(f"{name}.html" for name in [*names, "genindex", "search"])


PAGES = listed_pages()
HEIGHT = 900

AXE = """options => axe.run(document, options).then(({violations, incomplete}) => ({
  violations: violations.map(said),
  incomplete: incomplete.map(said),
}));
"""
RUN_AXE = """async options => {
  const {violations, incomplete} = await axe.run(document, options);
  const say = (rule) => rule.nodes.map((node) => {
    const checks = [...node.any, ...node.all, ...node.none];
    return {
      rule: rule.id,
      where: node.target.flat().join(" "),
      html: node.html.slice(0, 200),
      why: checks.map((check) => check.message).join(" "),
    };
  });
  return {violations: violations.flatMap(say), incomplete: incomplete.flatMap(say)};
}"""


def test_each_page_of_the_site_is_looked_at(built_site: Path, project: Project) -> None:
    assert page_names(built_site) == PAGES
    assert count_pages(project) == len(PAGES)
