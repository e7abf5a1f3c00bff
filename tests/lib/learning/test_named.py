"""A reader's own regressor: found, tried, and every way to be refused in one sentence."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.neighbors import KNeighborsRegressor

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning.named import ALLOWED, MODULES_VARIABLE, load_regressor

MEAN = """\
import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin

class Mean(RegressorMixin, BaseEstimator):
    def fit(self, X, y):
        self.mean_ = np.mean(y, axis=0)
        return self

    def predict(self, X):
        return np.full(len(X), self.mean_)
"""


@pytest.fixture(autouse=True)
def _as_it_was(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Take back what looking for a module adds to the path and to the modules."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delenv(MODULES_VARIABLE, raising=False)
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if name.startswith("own_"):
            del sys.modules[name]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("sklearn.linear_model:LinearRegression", LinearRegression),
        ("sklearn.neighbors:KNeighborsRegressor", KNeighborsRegressor),
    ],
)
def test_one_of_scikit_learn(text: str, found: type) -> None:
    machine = load_regressor("learner", text)
    assert type(machine) is found
    assert not hasattr(machine, "n_features_in_")  # the trial was of another one


@pytest.mark.parametrize("by", ["working folder", "variable"])
def test_a_module_of_the_readers_own(
    by: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"own_mean_{by[0]}"
    (tmp_path / f"{name}.py").write_text(MEAN)
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(ParameterError, match=f"importing {name} fails: ModuleNotFoundError"):
        load_regressor("learner", f"{name}:Mean")
    if by == "variable":
        monkeypatch.chdir(tmp_path / "elsewhere")
        monkeypatch.setenv(MODULES_VARIABLE, str(tmp_path))
    else:
        monkeypatch.chdir(tmp_path)
    machine = load_regressor("learner", f"{name}:Mean")
    assert machine.fit(np.zeros((4, 1)), [1, 2, 3, 6]).predict([[0.0]]) == pytest.approx([3.0])


def test_a_module_in_a_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "own_package" / "deep"
    folder.mkdir(parents=True)
    (folder / "mean.py").write_text(MEAN)
    monkeypatch.chdir(tmp_path)
    assert type(load_regressor("learner", "own_package.deep.mean:Mean")).__name__ == "Mean"


def test_an_installed_module_is_not_shadowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "colorsys.py").write_text("raise RuntimeError('the wrong one')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)
    with pytest.raises(ParameterError, match="colorsys has no class Mean"):
        load_regressor("learner", "colorsys:Mean")


@pytest.mark.parametrize(
    "text",
    [
        "nonsense", "", ":", "a:", ":B", "a.b", "a:b:c", "a:b.c", "a-b:C", "a..b:C", ".a:B",
        "a/b:C", "a: B", "1a:B", "sklearn.linear_model:LinearRegression()",
        "sklearn.linear_model:LinearRegression\n",
    ],
)  # fmt: skip
def test_a_text_of_another_form(text: str) -> None:
    with pytest.raises(ParameterError) as refusal:
        load_regressor("learner", text)
    assert str(refusal.value) == f"learner is {text!r}; it may be {ALLOWED}."


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (None, "importing own_{} fails: ModuleNotFoundError: No module named"),
        ("raise RuntimeError('no\\nluck')", "importing own_{} fails: RuntimeError: no."),
        ("def f(:", "importing own_{} fails: SyntaxError"),
        ("import sys; sys.exit('done')", "importing own_{} fails: SystemExit: done"),
        ("class Other: pass", "own_{} has no class Mean"),
        ("def Mean(): pass", "own_{} has no class Mean"),
        ("Mean = 3", "own_{} has no class Mean"),
        (MEAN.replace("predict", "forecast"), "Mean lacks one of fit, predict and get_params"),
        (MEAN.replace("def fit", "def train"), "Mean lacks one of fit, predict and get_params"),
        ("class Mean:\n    fit = predict = None", "Mean lacks one of fit, predict and get_params"),
        (
            MEAN + "\n    def __init__(self, size):\n        self.size = size",
            "making it, or a copy of it, fails: TypeError: .*size",
        ),
        (
            MEAN + "\n    def __init__(self, size=3):\n        self.size_ = size",
            "making it, or a copy of it, fails: AttributeError: .*size",
        ),
        (
            MEAN.replace("self.mean_ =", "raise ValueError('no fit')  #"),
            "a trial on 100 samples fails: ValueError: no fit",
        ),
        (
            MEAN.replace("return self\n", "pass\n"),
            "a trial on 100 samples fails: AttributeError: .*predict",
        ),
        (
            MEAN.replace("return np.full(len(X), self.mean_)", "return ['a'] * len(X)"),
            "a trial on 100 samples fails: ValueError: could not convert",
        ),
        (MEAN.replace("self.mean_)", "np.nan)"), "in a trial it predicts .2,., or numbers that"),
        (MEAN.replace("self.mean_)", "np.inf)"), "in a trial it predicts .2,., or numbers that"),
        (MEAN.replace("len(X), self", "3, self"), "in a trial it predicts .3,., or numbers that"),
        (MEAN.replace("len(X), self", "(2, 2), self"), "in a trial it predicts .2, 2., or"),
    ],
)
def test_a_module_that_will_not_do(
    body: str | None,
    why: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    name = f"own_{abs(hash(request.node.name))}"
    if body is not None:
        (tmp_path / f"{name}.py").write_text(body)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ParameterError, match=why.format(name.removeprefix("own_"))) as refusal:
        load_regressor("learner", f"{name}:Mean")
    said = str(refusal.value)
    assert said.startswith(f"learner is '{name}:Mean'; it may be {ALLOWED}; ")
    assert "\n" not in said
    assert refusal.value.name == "learner"
    assert refusal.value.__suppress_context__ or refusal.value.__context__ is None


def test_a_column_of_predictions_will_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_column.py").write_text(MEAN.replace("len(X), self", "(len(X), 1), self"))
    monkeypatch.chdir(tmp_path)
    assert load_regressor("learner", "own_column:Mean").get_params() == {}
