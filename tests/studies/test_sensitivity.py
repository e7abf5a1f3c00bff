"""The sensitivity study: its cells, the requests that they are, and what is kept of them."""

from __future__ import annotations

import random
from hashlib import sha256
from pathlib import Path

import pytest
import yaml
from conftest import MiniProject
from effects import band_of
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results
from inswsn_book.run import store as engine
from inswsn_book.run.assumptions import Assumptions, load_assumptions
from inswsn_book.run.store import ChapterError, request_key
from made_results import quantity, results
from sensitivity import FIGURE, Cell, cells_of, merged, request_of, run_of, with_page, write_study
from small import SMALL, run, study
from study import BASELINE, SENSITIVITY, Study, read_study

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

QUICK = 60.0  # seconds that a run may have taken in the study
NOT_REDUCED = ("printed-numbers", "p1-lmi")  # chapters whose headlines have no chance in them
ASSUMED = Assumptions.model_validate(SMALL)


@pytest.fixture(scope="module")
def assumptions(project: Project) -> Assumptions:
    """The list of assumptions."""
    return load_assumptions(project.root)


# Cells -------------------------------------------------------------------------------------------


def test_a_change_is_the_overlay_of_a_request(project: Project, assumptions: Assumptions) -> None:
    """The alternatives of the list itself."""
    cells = {cell.id + cell.chapter: cell for cell in cells_of(assumptions)}
    scenarios = project.root / "data/scenarios"
    path = "data/scenarios/{}.yaml".format

    def overlay(name: str) -> dict[str, str]:
        request = request_of(project, cells[name])
        assert request.parameters == cells[name].parameters
        return dict(request.overlay)

    source, made = project.by_id("p1-training").source, overlay("P1-M-path/cornerp1-training")
    assert set(made) == {path("p1"), f"chapters/evidence/{source.name}"}
    changed = yaml.safe_load(made[path("p1")])
    assert changed["waypoints"]["value"] == [[650, 0], [150, 200], [130, 400]]
    assert changed["waypoints"]["unit"] == "m"
    assert changed["speed"] == read_yaml(scenarios / "p1.yaml")["speed"]
    text = made[f"chapters/evidence/{source.name}"]
    head = "## Where each filter is right"
    assert (head in source.read_text(), head in text) == (True, False)
    assert "## Table 2, published and rebuilt" in text
    assert "record.write()" in text

    changed = yaml.safe_load(overlay("P3-M-imu/poorp3-vehicle")[path("p3")])
    told = read_yaml(scenarios / "p3.yaml")
    for name in ("gyro_noise", "filter_gyro_noise", "accelerometer_bias"):
        assert changed[name]["value"] == pytest.approx(3 * told[name]["value"], rel=1e-12)
    assert changed["gps_position_noise"] == told["gps_position_noise"]

    other = (scenarios / "p1-inertial-all-cells.yaml").read_text()
    assert overlay("P1-M-INS/all-cellsp1-outages")[path("p1-inertial")] == other

    (text,) = overlay("P1-M-L/positionsp1-lmi").values()
    assert text.count("L=np.eye(2, 4)") == 2
    assert "L=np.eye(2, 4)" not in project.by_id("p1-lmi").source.read_text()
    with pytest.raises(InswsnError, match="has no section 'No such section'"):
        request_of(project, Cell("baseline", "p1-lmi", skips=("No such section",)))


def test_the_cells_of_one_entry() -> None:
    assert [cell.id for cell in cells_of(ASSUMED, ["P1-M-scale"])] == [
        "baseline", "seed-1", "seed-2", "P1-M-scale/three", "P1-M-scale/ten",
    ]  # fmt: skip
    assert cells_of(ASSUMED, ["P2-M-word"]) == []
    with pytest.raises(InswsnError, match="no assumption P9"):
        cells_of(ASSUMED, ["P9-M-none"])


def test_what_came_of_a_cell_is_its_headlines_and_verdicts(mini: MiniProject) -> None:
    """The claim says 42; a headline that is not recorded is left out."""
    for value, verdict in ((42.0, "adds up in print"), (63.0, "contradicted by the paper itself")):
        cell = Cell("P1-M-scale/three", "00", {"scale": value / 21})
        found = results(quantity("twice", value), sentences={"So.": False})
        request = request_of(mini, cell)
        made = run_of(mini, cell, ASSUMED.headlines, engine.Run(request, found))
        assert (made.failed, made.headlines, made.overturned) == (None, {"twice": value}, 1)
        assert made.verdicts == {"P1-M-twice": verdict}
        assert made.key == request_key(mini, request)


def test_a_run_that_fails_is_a_result(mini: MiniProject) -> None:
    failure = ChapterError(
        f"Chapter 00 failed:\n\x1b[31mThe design\x1b[0m of {mini.root}/data/x has no solution.\n"
    )
    found = run_of(mini, Cell("baseline", "00"), ASSUMED.headlines, failure)
    assert (found.failed, found.headlines) == ("The design of data/x has no solution.", {})


# The file ----------------------------------------------------------------------------------------


def test_a_study_reads_back(tmp_path: Path) -> None:
    made = study(*(run(name) for name in ("baseline", "seed-1", "seed-2")))
    write_study(made, tmp_path / "study.json")
    assert read_study(tmp_path / "study.json") == made
    other = run("seed-1", seconds=50.0)
    runs = merged([other], {(one.chapter, one.id): one for one in made.runs})
    assert runs == (made.runs[0], other, made.runs[2])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"{", "is not a study: the file: Invalid JSON"),
        (b"{}", "is not a study: made: Field required"),
        (b'{"made": 1, "runs": []}', "is not a study: made: "),
        (b"\xff", "is not a study: it is not UTF-8"),
        (None, "make it with make studies"),
    ],
)
def test_a_bad_study_gives_one_sentence(tmp_path: Path, text: bytes | None, said: str) -> None:
    path = tmp_path / "study.json"
    if text is not None:
        path.write_bytes(text)
    with pytest.raises(InswsnError, match=r"\.$") as refused:
        read_study(path)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


# The stored study --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def stored(project: Project) -> Study:
    """The stored study."""
    return read_study(project.root / SENSITIVITY)


def test_it_holds_every_run_and_no_other(assumptions: Assumptions, stored: Study) -> None:
    wanted = {(cell.chapter, cell.id): cell.parameters for cell in cells_of(assumptions)}
    assert {(run.chapter, run.id): run.parameters for run in stored.runs} == wanted
    for chapter in assumptions.reduced:
        for one in stored.seeds(chapter):  # unchanged runs are whole
            assert one.failed is None
            assert set(one.headlines) == {h.key for h in assumptions.of_chapter(chapter)}
            assert one.verdicts


def test_the_baseline_agrees_with_the_published_results(
    assumptions: Assumptions, stored: Study, published: dict[str, Results]
) -> None:
    """Within what chance does to two runs of that size; exactly where there is no chance.

    One headline in ten may be outside of its band: each band holds with 95 %, and a few numbers,
    such as a least value over many, depend on the number of runs by themselves.
    """
    outside = []
    for headline in assumptions.headlines:
        chapter, key, edge = headline.chapter, headline.key, headline.turns
        baseline = stored.run(chapter, BASELINE)
        value, reference = baseline.headlines[key], headline.value(published[chapter])
        if chapter in NOT_REDUCED:
            assert value == pytest.approx(reference, rel=1e-4)
            continue
        band = band_of([one.headlines[key] for one in stored.seeds(chapter)])
        if abs(value - reference) > band:
            outside.append(key)
        assert value == pytest.approx(reference, rel=0.5)
        if edge is not None and abs(reference - edge) > band:
            assert (value - edge) * (reference - edge) > 0, f"{key}: another conclusion"
    assert len(outside) <= len(assumptions.headlines) / 10, outside


def rounded(value: object) -> object:
    """Return plain data with numbers as texts of six digits."""
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [rounded(inner) for inner in value]
    return f"{value:.6g}" if isinstance(value, float) else value


def test_what_the_page_shows_is_of_these_runs_and_of_the_reference(
    project: Project, assumptions: Assumptions, stored: Study
) -> None:
    now = with_page(project, assumptions, stored).page
    assert rounded(now) == rounded(stored.page), "Write it: python studies/sensitivity.py --page"
    assert (project.root / FIGURE).is_file()


@pytest.mark.whole
@pytest.mark.long
def test_one_run_comes_out_again(
    project: Project, assumptions: Assumptions, stored: Study, published: dict[str, Results]
) -> None:
    """A run that the content of the stored file chooses, among the quick ones.

    It may be off by what a fresh build may be from the reference results, and by one in a thousand.
    """
    digest = sha256((project.root / SENSITIVITY).read_bytes()).hexdigest()
    quick = {(r.chapter, r.id) for r in stored.runs if r.seconds < QUICK and r.failed is None}
    cells = [cell for cell in cells_of(assumptions) if (cell.chapter, cell.id) in quick]
    assert len(cells) > 5
    cell = random.Random(digest).choice(cells)
    before = stored.run(cell.chapter, cell.id)
    done = engine.run(project, request_of(project, cell), Quiet(), fresh=True)
    again = run_of(project, cell, assumptions.of_chapter(cell.chapter), done)
    assert again.failed is None
    assert again.headlines.keys() == before.headlines.keys()
    for headline in assumptions.of_chapter(cell.chapter):
        if headline.key in before.headlines:
            tolerance = published[cell.chapter][headline.quantity].tolerance
            assert again.headlines[headline.key] == pytest.approx(
                before.headlines[headline.key], rel=1e-3, abs=tolerance
            )
    # a claim that came after the study has no verdict in it
    assert before.verdicts
    assert {name: again.verdicts[name] for name in before.verdicts} == before.verdicts
