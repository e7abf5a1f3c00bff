"""The core of a chapter: what it computes over many runs, as a dataclass of the science library.

The head of a chapter's source names it, ``core: package.module:Class``. Its fields are parameters
of the chapter, and its method ``scores`` returns `inswsn_lib.evaluation.Scores`; one without chance
has ``findings`` alone. A parameter that is no field changes other sections of the chapter only. A
core that reads scenario files names them in ``scenarios``; a run may set what they say where no
parameter of the chapter stands for it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import fields, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from inswsn_book.record.files import file_digest
from inswsn_book.record.parameters import Parameter, Schema, Value, chapter_schema
from inswsn_book.record.project import Chapter, Project
from inswsn_book.record.results import Quantity, Results
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_text, read_yaml

if TYPE_CHECKING:
    from inswsn_lib.evaluation import Finding, Scores

#: The file of a run in which the words of a core's scores are kept, and who leads
SCORES = "scores.json"
# What a core may read, beside its parameters
_SCENARIOS = "data/scenarios"


def core_name(source: str) -> str | None:
    """Return what the source of a chapter names as its core; None if it names none."""
    head = source.partition("\n---\n")[0]
    found = re.search(r"^core: *(\S+:\S+)$", head, re.MULTILINE)
    return found[1] if found else None


def evidence_of(project: Project, chapter: Chapter) -> Chapter | None:
    """Return the evidence of a lesson, which its head names, ``evidence: p1-training``."""
    head = read_text(chapter.source).partition("\n---\n")[0]
    found = re.search(r"^evidence: *(\S+)$", head, re.MULTILINE)
    return project.by_id(found[1]) if found else None


def load_core(name: str) -> type[Any]:
    """Return the class of that name; refuse one that is not there."""
    module, _, kind = name.partition(":")
    try:
        return getattr(import_module(module), kind)  # type: ignore[no-any-return]
    except (ImportError, AttributeError) as error:
        raise InswsnError(f"There is no core {name}: {error}.") from None


def asked_schema(root: Path, chapter: Chapter, names: Iterable[str]) -> Schema:
    """Return the parameters of a chapter, and, if one of these names is none, its scene's.

    Those of the scene are the settings of its scenario files in whose place no parameter stands.
    """
    own = chapter_schema(root, chapter.id)
    if set(names) <= own.defaults.keys():
        return own
    return Schema((*own.parameters, *_scene_parameters(root, chapter, own.defaults)))


def _scene_parameters(root: Path, chapter: Chapter, own: Container[str]) -> Iterator[Parameter]:
    name = core_name(read_text(chapter.source))
    if name is None or not (scenarios := getattr(load_core(name), "scenarios", ())):
        return
    import numpy as np  # noqa: PLC0415  # the parent needs no numerics

    from inswsn_lib.scenario import load_scenario, with_values  # noqa: PLC0415

    core: Any = load_core(name)()
    kinds: dict[type, str] = {str: "str", list: "list"}
    for scenario in scenarios:
        for key, setting in load_scenario(root / _SCENARIOS / f"{scenario}.yaml").items():
            value, free = setting.value, key not in own
            if free and not isinstance(value, str):
                other = (np.asarray(value) * 2 + 1).tolist()
                changed = replace(core, published=with_values(core.published, **{key: other}))
                free = changed.settings[key].value != core.settings[key].value
            if free:
                kind = kinds.get(type(value), "float")
                yield Parameter(key, kind, value, setting.unit, "any", setting.why, scenario)


def changed_scenarios(root: Path, schema: Schema, values: Mapping[str, Value]) -> dict[str, str]:
    """Return the texts of the scenario files in which values change something, by path."""
    by_scenario: dict[str, dict[str, Value]] = {}
    for name, value in values.items():
        by_scenario.setdefault(schema[name].scenario, {})[name] = value
    return dict(changed_scenario(root, *changed) for changed in by_scenario.items())


def changed_scenario(
    root: Path, scenario: str, values: Mapping[str, Any], file: str | None = None
) -> tuple[str, str]:
    """Return the path of a scenario, and its text, or that of another, with some values changed."""
    path = root / _SCENARIOS / f"{file or scenario}.yaml"
    if not values:
        return f"{_SCENARIOS}/{scenario}.yaml", read_text(path)
    content = read_yaml(path)
    for key, value in values.items():
        content[key] |= {"value": value, "source": "assumed", "why": "Set for this run."}
    return f"{_SCENARIOS}/{scenario}.yaml", yaml.safe_dump(content, sort_keys=False)


def run_core(
    root: Path, chapter: Chapter, values: Mapping[str, Value], threads: int, *, brief: bool = False
) -> tuple[Results, dict[str, str]]:
    """Compute the core of a chapter; return its scores as results and as the file `SCORES`.

    A brief one has the findings alone, by the core's method ``findings`` where it has one.
    """
    from threadpoolctl import threadpool_limits  # noqa: PLC0415  # the parent needs no numerics

    name = core_name(read_text(chapter.source))
    if name is None:
        raise InswsnError(f"Chapter {chapter.id} has no core.")
    core = load_core(name)
    own, schema = {field.name for field in fields(core)}, asked_schema(root, chapter, values)
    given: dict[str, Any] = {n: v for n, v in values.items() if n in own}
    if scene := {n: v for n, v in values.items() if schema[n].scenario}:
        from inswsn_lib.scenario import with_values  # noqa: PLC0415

        given["published"] = with_values(core().published, **scene)
    with threadpool_limits(threads):
        made = core(**given)
        alone = hasattr(made, "findings") and (brief or not hasattr(made, "scores"))
        scores: Scores | None = None if alone else made.scores()
        findings: Mapping[str, Finding] = made.findings() if scores is None else scores.findings
    scenarios = sorted((root / _SCENARIOS).glob("*.yaml"))
    results = Results(
        chapter=chapter.id,
        parameters=dict(values),
        data={f"{_SCENARIOS}/{path.name}": file_digest(path) for path in scenarios},
        quantities=tuple(
            _quantities(
                findings,
                scores.runs if scores else getattr(made, "runs", 1),
                None if brief else scores,
            )
        ),
    )
    told = {name: found.how for name, found in findings.items()}
    if brief or scores is None:
        return results, {SCORES: json.dumps({"findings": told}, ensure_ascii=False)}
    best, error, after, lead = scores.leader()
    words = {
        "methods": {m: n for m, n in scores.methods.items() if m not in scores.baselines},
        "headline": scores.headline,
        "findings": told,
        "leader": {
            "best": best, "error": error, "next": after,
            "lead": lead.percent if after else None, "within": lead.within if after else None,
        },
    }  # fmt: skip
    return results, {SCORES: json.dumps(words, ensure_ascii=False)}


def _quantities(
    findings: Mapping[str, Finding], runs: int, scores: Scores | None
) -> Iterator[Quantity]:
    basis = "simulation" if runs > 1 else "algebra"
    common: dict[str, Any] = {"runs": runs, "basis": basis}
    for name, found in findings.items():
        yield Quantity(
            name=name,
            value=found.value,
            unit=found.unit,
            interval=(found.low, found.high) if runs > 1 else None,
            interval_kind=found.kind if runs > 1 else None,
            how=found.how,
            tolerance=1e-6,
            share=1e-3,
            **common,
        )
    if scores is None:
        return
    for row in scores.table().to_dict("records"):
        median = row["median"]
        yield Quantity(
            name=f"{row['method']}.{row['column']}",
            value=median,
            unit=row["unit"],
            interval=(row["low"], row["high"]),
            interval_kind="runs 95 %",
            **common,
            how=f"{row['column']}, {scores.methods[row['method']]}: median over runs.",
            tolerance=1e-6,
            share=1e-3,
        )
