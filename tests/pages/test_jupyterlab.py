"""Lesson 2 in JupyterLab, as `make lab` opens it: its figures move as on its page."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

pytestmark = [pytest.mark.page, pytest.mark.whole, pytest.mark.long]
NOTEBOOK = "2-blend-two-bad-instruments.ipynb"
SECONDS = 600  # to be installed, and to start
LONG = 240_000  # ms, for a kernel that starts on a busy machine, and all cells


@pytest.fixture
def lab(root: Path, tmp_path: Path) -> Iterator[tuple[str, str]]:
    """The address and the token of a JupyterLab that knows nothing of whoever runs the tests."""
    own = {f"JUPYTER_{name}_DIR": str(tmp_path / name) for name in ("CONFIG", "DATA", "RUNTIME")}
    shutil.copy(root / "chapters" / NOTEBOOK, tmp_path)  # not the copy that a reader may have
    words = f"--no-browser --ServerApp.root_dir={tmp_path}"
    words += " --allow-root" if os.geteuid() == 0 else ""
    log = tmp_path / "log"
    with log.open("w") as said, subprocess.Popen(
        ["make", "-o", "environment", "lab", f"LAB={words}"], cwd=root, stdout=said, stderr=said,
        env=os.environ | own | {"IPYTHONDIR": str(tmp_path / "ipython")}, start_new_session=True,
    ) as started:  # fmt: skip
        try:
            end = time.monotonic() + SECONDS
            while not (found := [*tmp_path.glob("RUNTIME/jpserver-*.json")]):
                if started.poll() is not None and not (root / "_build/jupyter/made").exists():
                    pytest.skip(f"JupyterLab cannot be installed here: {log.read_text()[-300:]}")
                assert started.poll() is None, log.read_text()
                assert time.monotonic() < end, log.read_text()
                time.sleep(0.2)
            about = json.loads(found[0].read_text())
            yield f"http://127.0.0.1:{about['port']}/", about["token"]
        finally:
            if started.poll() is None:
                os.killpg(started.pid, signal.SIGTERM)


def test_figures_move_in_jupyterlab(browser: Browser, lab: tuple[str, str], root: Path) -> None:
    address, token = lab
    page = browser.new_page(viewport={"width": 1400, "height": 1000})
    foreign: list[str] = []
    page.on("request", lambda r: None if r.url.startswith((address, "data:", "blob:"))
            else foreign.append(r.url))  # fmt: skip
    page.goto(f"{address}lab/tree/{NOTEBOOK}?token={token}")
    expect(page.get_by_text("Python 3 | Idle")).to_be_visible(timeout=LONG)
    for name in ("Run", "Run All Cells"):
        page.get_by_role("menuitem", name=name, exact=True).click()
    figure = page.locator("#fig-l2-map-moving")
    sentence = figure.locator(".moving-status")
    expect(sentence).to_contain_text("With a gain of 0.050", timeout=LONG)
    charts = figure.locator("svg[role=img]")
    before = charts.evaluate_all("(all) => all.map((chart) => chart.innerHTML)")
    assert len(before) == 2
    figure.get_by_label("gain g").press("End")
    expect(sentence).to_contain_text("With a gain of 1.000, the mean error of the blend is 17.3 cm")
    after = charts.evaluate_all("(all) => all.map((chart) => chart.innerHTML)")
    assert all(old != new for old, new in zip(before, after, strict=True))
    text = (root / "chapters" / NOTEBOOK).read_text(encoding="utf-8")
    figures = len(re.findall(r"blend\.show_(?!table)", text))
    assert figures > 5
    expect(page.locator("section.moving")).to_have_count(figures, timeout=LONG)
    assert foreign == []
    page.close()
