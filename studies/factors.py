"""What the crossed study varies: the alternatives of data/assumptions.yaml as ranges and as words.

A factor is what one alternative sets, or several of one entry that set the same. It has a place
from 0 to 1. Numbers go with it from end to end, the chosen value and the alternatives between them
or at the ends; words, paths and files are the parts of it, of equal length, the chosen one first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from inswsn_book.record.project import Project
from inswsn_book.run.assumptions import (
    Alternative,
    Assumption,
    Assumptions,
    load_assumptions,
    load_schemas,
    load_settings,
)

from inswsn_lib.scenario import Setting

#: Places of factors by their names
Point = Mapping[str, float]
#: What a level sets, by ``"scenario.setting"``, ``"chapter.parameter"`` or ``"file.scenario"``
Level = dict[str, Any]

#: The chapters whose results have indices
CROSSED = ("p1-lmi", "p1-training", "p1-outages", "p2-fusion")
#: Those whose points are too dear for indices: a sample tells their ranges
SAMPLED = ("p3-vehicle",)
#: All that are crossed: each has a function of a point in `points`
EVERY = (*CROSSED, *SAMPLED)
#: Why the others are not
ELSEWHERE = {
    "printed-numbers": "The evidence on the printed numbers computes no run: it counts printed "
    "claims.",
    "p3-vehicle": "The drives of a point of the evidence on P3's vehicle take too long for the "
    "thousands of points that indices need. A sample of them tells the ranges.",
}
#: Why a single alternative is not a factor, by its id or by that of its entry
LEFT_OUT = {
    "P1-M-L": "It is set by an edit of the text of the evidence on P1's LMI, which no parameter "
    "holds.",
    "P1-M-bp": "It is of the network alone, whose training takes too long; no result here rests "
    "on it.",
}
# settings that count something, by their units: they stay whole
_COUNTED = ("samples", "fixes")
# and parameters that do
_WHOLE = ("p3-vehicle.tau",)
# a place at the border of two words belongs to the latter, whatever its last digit
_BORDER = 1e-4


@dataclass(frozen=True)
class Factor:
    """One thing that is varied.

    Attributes
    ----------
    name : str
        The id of its entry, with that of its alternative where the entry has several factors.
    chapters : tuple of str
        In which it is varied, two digits.
    says : tuple of str
        What the alternatives set, in the words of the file.
    levels : tuple of dict
        What is chosen, and the alternatives.
    numeric : bool
        Whether it is a range of numbers.
    """

    name: str
    chapters: tuple[str, ...]
    says: tuple[str, ...]
    levels: tuple[Level, ...]
    numeric: bool

    @property
    def ends(self) -> tuple[Level, Level]:
        """The levels at 0 and at 1, if it is numeric: those that lie farthest apart."""
        key = next(iter(self.levels[0]))
        size = [float(np.sum(level[key])) for level in self.levels]
        if len(self.levels) == 2:
            return self.levels[0], self.levels[1]
        return self.levels[int(np.argmin(size))], self.levels[int(np.argmax(size))]

    def shift(self, place: float) -> Level:
        """Return by how much it moves each number from the chosen value, at a place."""
        low, high = self.ends
        return {
            key: np.subtract(low[key], chosen) + place * np.subtract(high[key], low[key])
            for key, chosen in self.levels[0].items()
        }

    def word(self, place: float) -> Level:
        """Return the level at a place, if it is not numeric."""
        count = len(self.levels)
        return self.levels[min(int(place * count + _BORDER), count - 1)]


@dataclass(frozen=True)
class Crossing:
    """All factors, with the values from which they are moved."""

    factors: tuple[Factor, ...]
    settings: Mapping[str, Mapping[str, Setting]]  # by scenario

    def of_chapter(self, chapter: str) -> list[Factor]:
        """Return the factors of a chapter."""
        return [factor for factor in self.factors if chapter in factor.chapters]

    def changes(self, chapter: str, point: Point) -> Level:
        """Return what a point sets in a chapter.

        Several factors may move one number, as those that shift the second area of P1 along its
        path; their shifts are added.
        """
        moved: dict[str, Any] = {}
        words: Level = {}
        for factor in self.of_chapter(chapter):
            if not factor.numeric:
                words |= factor.word(point[factor.name])
                continue
            for key, shift in factor.shift(point[factor.name]).items():
                moved[key] = moved.get(key, factor.levels[0][key]) + shift
        return words | {key: self._rounded(key, value) for key, value in moved.items()}

    def _rounded(self, key: str, value: Any) -> Any:
        scenario, name = key.split(".", 1)
        setting = self.settings.get(scenario, {}).get(name)
        if key in _WHOLE:
            return round(float(value))
        counted = setting is not None and setting.unit in _COUNTED
        return np.round(value).tolist() if counted else np.asarray(value).tolist()

    def chosen(self) -> dict[str, float]:
        """Return the point at which everything is as chosen."""
        return {factor.name: _place_of_chosen(factor) for factor in self.factors}


def _place_of_chosen(factor: Factor) -> float:
    if not factor.numeric:
        return 0.0
    key = next(iter(factor.levels[0]))
    low, high = (float(np.sum(end[key])) for end in factor.ends)
    return (float(np.sum(factor.levels[0][key])) - low) / (high - low)


def load_crossing(project: Project, crossed: tuple[str, ...] = CROSSED) -> Crossing:
    """Return the factors that data/assumptions.yaml gives for some chapters."""
    assumptions, settings = load_assumptions(project.root), load_settings(project.root)
    values: Level = {
        f"{scenario}.{name}": setting.value
        for scenario, found in settings.items()
        for name, setting in found.items()
    }
    for chapter, schema in load_schemas(project).items():
        values |= {f"{chapter}.{name}": value for name, value in schema.defaults.items()}
    factors = [f for entry in assumptions.assumptions for f in _factors_of(entry, values, crossed)]
    return Crossing((*factors, *_seeds(assumptions, values, crossed)), settings)


def reasons(assumptions: Assumptions) -> dict[str, str]:
    """Return why an alternative is no factor, by ``"entry/alternative"``."""
    found = {}
    for entry in assumptions.assumptions:
        for other in entry.alternatives:
            name = f"{entry.id}/{other.id}"
            if entry.id in LEFT_OUT or name in LEFT_OUT:
                found[name] = LEFT_OUT.get(entry.id) or LEFT_OUT[name]
            elif not set(other.chapters) & set(CROSSED):
                found[name] = ELSEWHERE[other.chapters[0]]
    return found


def _factors_of(entry: Assumption, values: Level, crossed: tuple[str, ...]) -> Iterable[Factor]:
    """Return the factors of an entry: alternatives that set the same are one."""
    groups: dict[frozenset[str], list[tuple[Alternative, Level]]] = {}
    for other in entry.alternatives:
        if entry.id in LEFT_OUT or not set(other.chapters) & set(crossed):
            continue
        level = _level_of(other, values)
        groups.setdefault(frozenset(level), []).append((other, level))
    for found in groups.values():
        others = [other for other, _ in found]
        levels = tuple(level for _, level in found)
        yield Factor(
            name=f"{entry.id}/{others[0].id}" if len(groups) > 1 else entry.id,
            chapters=tuple(c for c in crossed if c in others[0].chapters),
            says=tuple(other.set for other in others),
            levels=({key: values.get(key, _file(key)) for key in levels[0]}, *levels),
            numeric=all(_is_number(v) for level in levels for v in level.values()),
        )


def _level_of(other: Alternative, values: Level) -> Level:
    level: Level = {}
    for scenario, found in other.values.items():
        level |= {f"{scenario}.{name}": value for name, value in found.items()}
    for scenario, times in other.factors.items():
        keys = {f"{scenario}.{name}": factor for name, factor in times.items()}
        level |= {key: np.multiply(values[key], factor).tolist() for key, factor in keys.items()}
    for chapter, given in other.parameters.items():
        level |= {f"{chapter}.{name}": value for name, value in given.items()}
    return level | {f"file.{scenario}": file for scenario, file in other.files.items()}


def _file(key: str) -> str:
    return key.removeprefix("file.")  # a scenario is read from the file of its own name


def _is_number(value: Any) -> bool:
    """Tell numbers and flat lists of them from words and from points of a path."""
    flat = value if isinstance(value, list) else [value]
    return all(isinstance(part, int | float) for part in flat)


def _seeds(assumptions: Assumptions, values: Level, crossed: tuple[str, ...]) -> Iterable[Factor]:
    """Return the seeds as factors: what they do is what chance does."""
    for entry in assumptions.assumptions:
        chapters = [c for c in crossed if c in entry.seeds and c != "p1-lmi"]  # no chance there
        if chapters:
            seeds = assumptions.reduced[chapters[0]].seeds
            keys = [f"{chapter}.seed" for chapter in chapters]
            others = tuple(dict.fromkeys(keys, seed) for seed in seeds)
            yield Factor(
                name=entry.id,
                chapters=tuple(chapters),
                says=tuple(f"seed {seed}" for seed in seeds),
                levels=({key: values[key] for key in keys}, *others),
                numeric=False,
            )
