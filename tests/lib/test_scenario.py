"""Settings: what a file gives, what a run changes, and what makes a dataclass."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.scenario import (
    Pair,
    Range,
    Setting,
    between,
    from_settings,
    load_scenario,
    with_values,
)


@dataclass
class Radio:
    reach: float = between(1, 100)
    power: float = between(0, 1, 0.5)


@dataclass
class Place:
    radio: Radio
    kind: Literal["room", "hall"]
    word: str
    size: Pair = between(1, 10)
    span: Range = between(0, 5)
    corners: tuple[Pair, ...] = between(-1, 1)
    count: int = between(2, 8)


GOOD = {
    "reach": 1, "power": 1.0, "kind": "hall", "word": "any", "size": [10, 1], "span": [0, 5],
    "corners": [[-1, 1], [0, 0], [1, -1]], "count": 2, "other": 5,
}  # fmt: skip


def told(values: dict[str, Any]) -> dict[str, Setting]:
    return {name: Setting(value, "m", "paper", "So.") for name, value in values.items()}


def test_a_dataclass_is_made_of_the_settings_of_its_fields() -> None:
    found = from_settings(Place, told(GOOD))
    corners = ((-1.0, 1.0), (0.0, 0.0), (1.0, -1.0))
    assert found == Place(Radio(1.0, 1.0), "hall", "any", (10.0, 1.0), (0.0, 5.0), corners, 2)
    assert isinstance(found.count, int)
    assert Radio(2.0).power == 0.5  # by hand, a field may have a default
    assert from_settings(Place, told(GOOD | {"span": [2, 2]})).span == (2.0, 2.0)
    given = from_settings(Place, told(GOOD), radio=Radio(7.0), count=99)
    assert (given.radio.reach, given.count) == (7.0, 99)  # what is given is not looked at


@pytest.mark.parametrize("name", [name for name in GOOD if name != "other"])
def test_a_setting_that_is_missing(name: str) -> None:
    settings = told(GOOD)
    del settings[name]
    with pytest.raises(InswsnError, match=f"^The scenario lacks the setting {name}.$"):
        from_settings(Place, settings)


@pytest.mark.parametrize(
    ("name", "value", "must_be"),
    [
        ("reach", 0.9, "a number between 1 and 100"),
        ("reach", 100.1, "a number between 1 and 100"),
        ("reach", "far", "a number"),
        ("reach", [2.0], "a number"),
        ("kind", "cellar", 'one of "room", "hall"'),
        ("kind", 1.0, "one of"),
        ("size", [0.9, 5], "numbers between 1 and 10"),
        ("size", [5, 10.1], "numbers between 1 and 10"),
        ("size", [5, 5, 5], r"finite numbers of shape \(2,\)"),
        ("size", 5.0, r"finite numbers of shape \(2,\)"),
        ("span", [3, 2], "two numbers in ascending order"),
        ("span", [1, 2, 3], r"finite numbers of shape \(2,\)"),
        ("corners", [[0, 0, 0]], r"finite numbers of shape \(any, 2\)"),
        ("corners", [0, 0], r"finite numbers of shape \(any, 2\)"),
        ("corners", [[0, np.nan]], "finite numbers"),
        ("count", 2.5, "a whole number"),
        ("count", 1, "between 2 and 8"),
        ("count", 9, "between 2 and 8"),
    ],
)
def test_a_value_of_another_form_or_out_of_range(name: str, value: Any, must_be: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{name} must be .*{must_be}"):
        from_settings(Place, told(GOOD | {name: value}))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("- 1", "is not a scenario"),
        ("speed: {value: 1, unit: m/s, source: guessed, why: so}", "speed: source"),
        ("speed: {value: 1, unit: '', source: paper, why: so}", "speed: unit"),
        ("speed: {value: 1, unit: m/s, source: paper, why: 2}", "speed: why"),
        ("speed: {value: [1, [2]], unit: m/s, source: paper, why: so}", "speed: value"),
        ("speed: {value: 1, unit: m/s, source: paper}", "speed must have"),
        ("speed: 1", "speed must have"),
    ],
)
def test_a_file_that_is_not_complete(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(text)
    with pytest.raises(InswsnError, match=rf"s.yaml.*{said}"):
        load_scenario(path)


def test_a_file_is_read_in_its_order(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(
        "speed: {value: 3, unit: m/s, source: inferred, why: a}\n"
        "kind: {value: hall, unit: '1', source: assumed, why: b}\n"
    )
    assert list(load_scenario(path).items()) == [
        ("speed", Setting(3.0, "m/s", "inferred", "a")),
        ("kind", Setting("hall", "1", "assumed", "b")),
    ]


def test_what_changes_is_assumed_and_what_does_not_stays() -> None:
    settings = told({"speed": 7.5, "size": [1, 2], "kind": "hall"})
    changed = with_values(settings, speed=7.5, size=np.array([1, 3]), kind="room")
    assert changed["speed"] is settings["speed"]
    assert changed["size"] == Setting([1.0, 3.0], "m", "assumed", "Set for this run.")
    assert (changed["kind"].value, settings["kind"].value) == ("room", "hall")
    assert with_values(settings, size=np.array([1, 2])) == settings
    for name, value in (("speed", None), ("size", [[1.0], [1.0, 2.0]]), ("kind", 1j)):
        with pytest.raises(ParameterError, match=f"^{name} must be a number, a word, or"):
            with_values(settings, **{name: value})
    with pytest.raises(ParameterError, match="setting must be one of kind, size, sp"):
        with_values(settings, sped=1.0)


def test_every_scenario_of_the_book_is_complete_and_says_why(root: Path) -> None:
    for path in sorted((root / "data" / "scenarios").glob("*.yaml")):
        settings = load_scenario(path)
        assert settings
        # a text that is there, and no place holder
        assert all(len(setting.why) > 5 for setting in settings.values()), path.name
