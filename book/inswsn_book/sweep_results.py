"""What a sweep leaves: one tidy table, a figure, where they come from, and what failed."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table

from inswsn_book.experiments.summary import draw_summary, leading_methods, tidy_results
from inswsn_book.files import write_whole
from inswsn_book.parameters import Value
from inswsn_book.project import Project
from inswsn_book.provenance import machine_facts, repository_state
from inswsn_book.results import Results
from inswsn_book.sweep_plan import Plan
from inswsn_book.sweep_store import Store
from inswsn_book.sweep_tasks import unpacked
from inswsn_lib import __version__
from inswsn_lib.errors import ParameterError

_MOST_ROWS = 40


@dataclass(frozen=True)
class Finished:
    """A sweep that has come to its end.

    Attributes
    ----------
    folder : Path
        Where its files are.
    cells : int
        Cells of the grid.
    failed : dict of str to str
        Why cells failed, by what they are called.
    leaders : list of dict
        For each cell which method leads; empty if a chapter was executed in each.
    kept, computed : int
        Runs that were there, and that this call computed; cells, if a chapter was executed in each.
    no_figure : str
        Why there is none, or empty.
    """

    folder: Path
    cells: int
    failed: Mapping[str, str]
    leaders: list[dict[str, Any]]
    kept: int
    computed: int
    no_figure: str


def cell_name(place: Mapping[str, Value]) -> str:
    """Return what a cell is called: its values on the axes."""
    return ", ".join(f"{name}={value}" for name, value in place.items()) or "the one cell"


def write_results(
    project: Project, plan: Plan, store: Store, *, kept: int, computed: int
) -> Finished:
    """Write the files of a sweep, each whole or not at all.

    Parameters
    ----------
    project : Project
        The checkout.
    plan : Plan
        The sweep.
    store : Store
        What is there of it.
    kept, computed : int
        As in `Finished`.
    """
    failed = store.failed()
    places = plan.grid.places()
    frames, leaders = [], []
    for cell, place in enumerate(places):
        contents = store.read(cell, plan.parts)
        if len(contents) < plan.parts:
            continue
        if plan.experiment is None:
            frames.append(_rows_of_chapter(place, Results.model_validate_json(contents[0])))
        else:
            found = unpacked(plan.experiment, contents, plan.runs)
            frames.append(tidy_results(plan.experiment, place, found))
            leaders.append(leading_methods(plan.experiment, place, found))
    folder = store.folder
    none = pd.DataFrame(columns=[*plan.grid.axes])
    table = pd.concat(frames, ignore_index=True) if frames else none
    _write_table(folder / "sweep.csv", table)
    if failed:
        rows = [places[cell] | {"reason": reason} for cell, reason in failed.items()]
        _write_table(folder / "failed.csv", pd.DataFrame(rows))
    else:
        (folder / "failed.csv").unlink(missing_ok=True)
    no_figure = _write_figure(folder / "sweep.svg", plan, table)
    write_whole(folder / "sweep.json", _provenance(project, plan, store))
    return Finished(
        folder=folder,
        cells=len(places),
        failed={cell_name(places[cell]): reason for cell, reason in failed.items()},
        leaders=leaders,
        kept=kept,
        computed=computed,
        no_figure=no_figure,
    )


def _write_table(path: Path, table: pd.DataFrame) -> None:
    write_whole(path, table.to_csv(index=False, lineterminator="\n"))


def _rows_of_chapter(place: Mapping[str, Value], results: Results) -> pd.DataFrame:
    rows = []
    for quantity in results.quantities:
        low, high = quantity.interval or (None, None)
        rows.append(
            {
                **place,
                "quantity": quantity.name,
                "unit": quantity.unit,
                "runs": quantity.runs,
                "value": quantity.value,
                "low": low,
                "high": high,
                "interval": quantity.interval_kind,
            }
        )
    return pd.DataFrame(rows)


def _write_figure(path: Path, plan: Plan, table: pd.DataFrame) -> str:
    """Draw the figure, or return why there is none."""
    path.unlink(missing_ok=True)
    if plan.experiment is None:
        return "a chapter without an experiment of its own says nothing of what to draw."
    if table.empty:
        return "no cell is complete."
    if not plan.grid.axes:
        return "there is one cell; --grid names an axis."
    try:
        fig = draw_summary(plan.experiment, table, list(plan.grid.axes))
    except ParameterError as error:
        return str(error)
    # a file is passed on without the page that explains it
    told = f"Lines: medians of {plan.runs:,} runs. Bands: from 2.5 to 97.5 % of them."
    fig.supxlabel(told, fontsize="small")
    stream = io.StringIO()
    fig.savefig(
        stream,
        format="svg",
        metadata={"Title": f"{plan.name}. {told}", "Date": None, "Creator": None},
        facecolor="white",
    )
    write_whole(path, stream.getvalue())
    return ""


def _provenance(project: Project, plan: Plan, store: Store) -> str:
    commit, clean = repository_state(project.root)
    facts = {
        "version": __version__,
        "commit": commit,
        "clean": clean,
        "experiment": plan.source,
        "title": plan.experiment.title if plan.experiment else None,
        "grid": {name: list(values) for name, values in plan.grid.axes.items()},
        "parameters": {
            name: value for name, value in plan.grid.values.items() if name not in plan.grid.axes
        },
        "runs": plan.runs,
        "failed cells": len(store.failed()),
        "made from": dict(plan.made_from),
        "digest": plan.digest,
        "finished": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "computed by": store.computed_by(),
        "machine of the command": machine_facts(),
    }
    return json_text(facts)


def json_text(facts: Mapping[str, Any]) -> str:
    """Return facts as indented JSON."""
    return json.dumps(facts, indent=2, ensure_ascii=False) + "\n"


def show_leaders(plan: Plan, finished: Finished, console: Console) -> None:
    """Write which method leads in each cell, and by how much.

    Parameters
    ----------
    plan : Plan
        The sweep.
    finished : Finished
        What came of it.
    console : rich.console.Console
        Where to write.
    """
    experiment = plan.experiment
    if experiment is None or not finished.leaders:
        return
    unit = experiment.columns[experiment.headline]
    table = Table(
        *plan.grid.axes, "best", f"{experiment.headline} ({unit})", "next", "less than next by",
        box=None, pad_edge=False,
    )  # fmt: skip
    for row in finished.leaders[:_MOST_ROWS]:
        lead = "" if row["next"] is None else f"{row['lead']:.2f} ± {row['within']:.2f} %"
        table.add_row(
            *(str(row[name]) for name in plan.grid.axes),
            row["best"], f"{row['error']:.4g}", row["next"] or "", lead,
        )  # fmt: skip
    console.print(table)
    if len(finished.leaders) > _MOST_ROWS:
        console.print(f"and {len(finished.leaders) - _MOST_ROWS} cells more, in sweep.csv")
