"""The crossed study: indices against exact ones, points that are kept, and one computed again."""

from __future__ import annotations

import datetime
import json
import os
import random
from pathlib import Path

import numpy as np
import pytest
from conftest import Render
from crossed import (
    CROSSED_FILE,
    FIGURE,
    OTHERS,
    REPEATED,
    Crossed,
    Lab,
    column,
    headlines_of,
    label,
    places_of,
    read_crossed,
    spread_of,
    strongest_of,
)
from factors import EVERY, Crossing, load_crossing, reasons
from indices import filled, morris_effects, morris_places, sobol_places, sobol_shares
from inswsn_book.record.chapter import MOST_TURNED, told_turning
from inswsn_book.record.project import Project
from inswsn_book.run.assumptions import load_assumptions
from points import outputs_at

from inswsn_lib.checks import Array

MOST_BYTES = 100_000
#: Of a result that is computed again: what solvers on another machine may do
TOLERANCE = 1e-3


def ishigami(places: Array) -> Array:
    """The function of Ishigami and Homma with 7 and 0.1, and a fourth factor without effect."""
    x = np.pi * (2 * places - 1)
    return np.asarray(np.sin(x[:, 0]) * (1 + 0.1 * x[:, 2] ** 4) + 7 * np.sin(x[:, 1]) ** 2)


def test_the_indices_of_a_known_function_come_out() -> None:
    """Ishigami's are known in closed form."""
    names = ["a", "b", "c", "idle"]
    found = sobol_shares(names, names, ishigami(sobol_places(names, names, 1024, 1)), 1)
    exact = {"a": (0.3139, 0.5576), "b": (0.4424, 0.4424), "c": (0, 0.2437), "idle": (0, 0)}
    for name, (first, total) in exact.items():
        assert found[name].first == pytest.approx(first, abs=0.03)
        assert found[name].total == pytest.approx(total, abs=0.03)
        assert found[name].total_low <= total <= found[name].total_high
        assert found[name].total_high - found[name].total_low < 0.3


def test_factors_of_one_group_have_one_share() -> None:
    """A sum of 3 a + 2 b + c: the shares of variance are 9, and 4 and 1 together, of 14."""
    names, groups = ["a", "b", "c"], ["a", OTHERS, OTHERS]
    places = sobol_places(names, groups, 1024, 1)
    assert places.shape == (1024 * 4, 3)
    found = sobol_shares(names, groups, places @ [3.0, 2.0, 1.0], 1)
    assert found.keys() == {"a", OTHERS}
    assert [found[g].first for g in ("a", OTHERS)] == pytest.approx([9 / 14, 5 / 14], abs=0.02)
    assert [found[g].total for g in ("a", OTHERS)] == pytest.approx([9 / 14, 5 / 14], abs=0.02)


def test_the_screening_of_a_linear_function_is_exact() -> None:
    """The effect of a factor is its coefficient everywhere; that of a product is not."""
    names = ["a", "b", "c", "idle"]
    places = morris_places(names, 20, 1)
    assert places.shape == (100, 4)
    found = morris_effects(names, places, places @ [3.0, -2.0, 0.5, 0.0], 1)
    assert [found[n].mean for n in names] == pytest.approx([3.0, 2.0, 0.5, 0.0], abs=1e-3)
    assert max(found[n].deviation for n in names) < 1e-4
    assert morris_effects(names, places, places[:, 0] * places[:, 1], 1)["a"].deviation > 0.1


def test_the_effect_of_a_word_is_what_changing_it_does() -> None:
    names = ["number", "word"]
    places = morris_places(names, 20, 1)
    values = places[:, 0] + 5.0 * (places[:, 1] > 0.5)
    found = morris_effects(names, places, values, 1, words={"word"})
    assert [found[name].mean for name in names] == pytest.approx([1.0, 5.0], abs=1e-3)


def test_a_result_that_nothing_moves_has_no_shares_and_a_missing_one_is_the_median() -> None:
    names = ["a", "b"]
    flat = sobol_shares(names, names, np.full(len(sobol_places(names, names, 8, 1)), 2.0), 1)
    assert {share.total for share in flat.values()} == {0.0}
    assert filled(np.array([1.0, np.nan, 2.0, 9.0])).tolist() == [1.0, 2.0, 2.0, 9.0]


def test_a_distribution_tells_on_which_side_it_lies(project: Project) -> None:
    headline = load_assumptions(project.root).headline("p1-training", "headline.kf-share")
    found = spread_of(headline, np.array([50.0, 80.0, 90.0, 120.0, np.nan]), 60.0, 40.0)
    assert (found.turned, found.failed, found.quantiles[2]) == (0.25, 1, 85.0)
    assert spread_of(headline, np.array([50.0, 80.0, 90.0, 120.0]), 60.0, 140.0).turned == 0.75
    assert column([{"x": 1.0}, {}], "x").tolist() == pytest.approx([1.0, np.nan], nan_ok=True)


def test_what_turns_at_more_than_a_quarter_of_the_points_is_told_as_undecided() -> None:
    assert told_turning(0.25) == "fails at 25 % of the points"
    assert told_turning(0.26) == "fails at 26 % of the points, so it is undecided"
    assert told_turning(0.75).endswith("75 % of the points, so it is undecided")
    assert told_turning(0.76).endswith("76 % of the points, so it is the exception")


def test_computed_points_are_not_computed_again(tmp_path: Path, crossing: Crossing) -> None:
    """A line that was cut off when the study was stopped is left out."""
    names = [factor.name for factor in crossing.of_chapter("p1-lmi")]
    kept = [["starts", {"Kalman": [1.0, 1.0]}, 5.0], ["p1-lmi 0.1 0.2 0.3 0.4", {"x": 7.0}, 2.0]]
    lines = "".join(json.dumps(line) + "\n" for line in kept)
    (tmp_path / "cache").write_text(lines + '["p1-lmi 0.5', encoding="utf-8")
    lab = Lab(tmp_path, crossing, tmp_path / "cache", jobs=1)
    assert lab.starts == {"Kalman": [1.0, 1.0]}
    point = dict(zip(names, (0.1, 0.2, 0.3, 0.4), strict=True))
    assert lab.compute("p1-lmi", [point, point]) == [{"x": 7.0}] * 2
    assert lab.seconds == 7.0


# The stored study --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def crossing(project: Project) -> Crossing:
    return load_crossing(project)


@pytest.fixture(scope="module")
def stored(project: Project) -> Crossed:
    return read_crossed(project.root / CROSSED_FILE)


def test_it_is_of_these_factors_and_large(
    project: Project, crossing: Crossing, stored: Crossed
) -> None:
    assert (project.root / CROSSED_FILE).stat().st_size < MOST_BYTES
    assert (project.root / FIGURE).is_file()
    assert stored.trajectories >= 20
    assert stored.base >= 256
    assert [f.name for f in stored.factors] == [f.name for f in crossing.factors]
    assert stored.left_out == reasons(load_assumptions(project.root))
    assert stored.strongest == strongest_of({f.name: f.strength for f in stored.factors})
    assert len(stored.kept) >= 40
    for name, found in stored.shares.items():
        own = {factor.name for factor in crossing.of_chapter(name.partition(" ")[0])}
        assert found.keys() - {OTHERS} == own & set(stored.strongest)
        assert stored.screening[name].keys() == own
        assert stored.spreads[name].quantiles == tuple(sorted(stored.spreads[name].quantiles))


def test_the_readme_calls_undecided_what_turns(stored: Crossed) -> None:
    said = ("p1-training fair.hf-exact-lmi.position/fair.kalman.position",
            "p1-outages fair.ls-svm.motion/fair.kalman-filter-coasting.state",
            "p2-fusion fair.dhf-over-fkf.position",
            "p2-fusion fair.dhf-over-fkf.velocity")  # fmt: skip
    shares = [stored.spreads[name].turned or 0.0 for name in said]
    assert min(shares) > MOST_TURNED
    assert shares[1] > 0.5  # in outages the filter is mostly ahead


def test_the_front_page_tells_no_headline_that_turns_as_decided(
    stored: Crossed, render: Render
) -> None:
    page = " ".join(render("index").split())
    spread = stored.spreads["p1-training headline.kf-share"]
    assert spread.turned is not None
    assert f"that it is less than all of it {told_turning(spread.turned)})" in page
    assert page.count("the order there fails at") == 3


def test_its_page_names_the_conclusions_that_turn(
    project: Project, stored: Crossed, render: Render
) -> None:
    section = render("assumptions").split("\n## Crossed\n")[1]
    said = section.split("the conclusion is the other one for: ")[1].split(". Up to three")[0]
    headlines = {label(h): h for h in load_assumptions(project.root).headlines}
    turned = []
    for name, spread in stored.spreads.items():
        if spread.turned is not None and spread.turned > 0.25:
            short = headlines[name].short
            turned.append(f"chapter {name.split()[0]}, {short} ({100 * spread.turned:.0f} %)")
    assert said.replace("\N{NO-BREAK SPACE}", " ") == "; ".join(turned)


@pytest.mark.long
def test_one_point_comes_out_again(project: Project, crossing: Crossing, stored: Crossed) -> None:
    """Another one each day, or that of INSWSN_SEED."""
    seed = int(os.environ.get("INSWSN_SEED") or datetime.datetime.now(datetime.UTC).toordinal())
    draw = random.Random(seed)
    place, chapter = draw.randrange(REPEATED), draw.choice(EVERY)
    sampled, before = stored.sampled, dict[str, float | None]()
    if sampled and chapter in sampled.chapters:
        point = places_of(sampled.chapters[chapter], sampled.points)[place]
        starts, before = sampled.starts, {name: kept[place] for name, kept in sampled.kept.items()}
    else:
        kept = stored.kept[place]
        point = {f.name: at for f, at in zip(stored.factors, kept.places, strict=True)}
        starts, before = stored.starts, dict(zip(stored.spreads, kept.values, strict=False))
    again = outputs_at(load_crossing(project, EVERY), starts, chapter, point)
    named = headlines_of(load_assumptions(project.root), {chapter: again})
    now = {label(h): again[h.key] for h in named}
    own = {n: v for n, v in before.items() if n.startswith(f"{chapter} ") and v is not None}
    where = f"point {place} in chapter {chapter}; INSWSN_SEED={seed} asks for it again"
    assert now == pytest.approx(own, rel=TOLERANCE, abs=TOLERANCE), where
