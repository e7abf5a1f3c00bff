"""A reader's own regressor: found, tried, and every way to be refused in one sentence."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from sklearn.ensemble import GradientBoostingRegressor
from sklearn.linear_model import LinearRegression
from sklearn.multioutput import MultiOutputRegressor
from sklearn.neighbors import KNeighborsRegressor

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import LSSVMRegressor, load_regressor
from inswsn_lib.learning.own import ALLOWED, MODULES_VARIABLE

MEAN = """\
import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin

class Mean(RegressorMixin, BaseEstimator):
    def fit(self, X, y):
        self.mean_ = np.mean(y, axis=0)
        return self

    def predict(self, X):
        return np.tile(self.mean_, (len(X), 1))
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
        ("inswsn_lib.learning:LSSVMRegressor", LSSVMRegressor),
    ],
)
def test_what_takes_several_outputs_is_itself(text: str, found: type) -> None:
    machine = load_regressor("learner", text)
    assert type(machine) is found
    assert not hasattr(machine, "n_features_in_")  # the trial was of another one


def test_what_takes_one_output_is_copied_for_each_with_its_seed() -> None:
    text = "sklearn.ensemble:GradientBoostingRegressor"
    machine = load_regressor("learner", text, seed=7)
    assert isinstance(machine, MultiOutputRegressor)
    assert machine.estimator.random_state == 7
    rng = np.random.default_rng(1)
    X, y = rng.normal(size=(20, 2)), rng.normal(size=(20, 2))
    predicted = machine.fit(X, y).predict(X)
    for i in range(2):
        alone = GradientBoostingRegressor(random_state=7).fit(X, y[:, i]).predict(X)
        assert predicted[:, i] == pytest.approx(alone)


@pytest.mark.parametrize("by", ["working folder", "variable"])
@pytest.mark.parametrize("flat", [False, True])
def test_a_module_of_the_readers_own(
    flat: bool, by: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One whose fit returns nothing, and that predicts one column, is tried for each output."""
    name = f"own_{tmp_path.name}"
    body = MEAN.replace("return self\n", "pass\n").replace("(len(X), 1)", "len(X)")
    (tmp_path / f"{name}.py").write_text(body if flat else MEAN)
    with pytest.raises(ParameterError, match=f"importing Mean from {name} fails: ModuleN"):
        load_regressor("learner", f"{name}:Mean")
    if by == "variable":
        monkeypatch.setenv(MODULES_VARIABLE, str(tmp_path))
    else:
        monkeypatch.chdir(tmp_path)
    machine = load_regressor("learner", f"{name}:Mean")
    assert isinstance(machine, MultiOutputRegressor) == flat
    predicted = machine.fit([[0.0], [1.0]], [[2.0, 5.0], [4.0, 7.0]]).predict([[9.0]])
    assert predicted.tolist() == [[3.0, 6.0]]


NAMED = """\
from sklearn.linear_model import Ridge
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

ridge = Ridge(alpha=10)
chain = make_pipeline(StandardScaler(), MLPRegressor(max_iter=3))
fixed = MLPRegressor(max_iter=3, random_state=5)

def made():
    return Ridge(alpha=3)
"""


@pytest.mark.filterwarnings("ignore:Stochastic Optimizer")
def test_an_instance_a_pipeline_and_a_function_that_makes_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"own_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(NAMED)
    monkeypatch.chdir(tmp_path)
    ridge, chain, fixed, made = (
        load_regressor("learner", f"{name}:{each}", seed=7)
        for each in ("ridge", "chain", "fixed", "made")
    )
    assert (ridge.alpha, made.alpha) == (10, 3)
    assert ridge is not sys.modules[name].ridge  # what a module holds is not trained
    assert chain.get_params()["mlpregressor__random_state"] == 7
    assert fixed.random_state == 5  # as it was set
    X = np.random.default_rng(0).normal(size=(30, 2))
    assert np.array_equal(chain.fit(X, X).predict(X), chain.fit(X, X).predict(X))


@pytest.mark.parametrize(
    "text",
    [
        "nonsense", "a:", ":B", "a:b:c", "a:b.c", "a-b:C", "a..b:C", ".a:B", "a/b:C", "a: B",
        "1a:B", "a:B()", "a:B\n",
    ],
)  # fmt: skip
def test_a_text_of_another_form(text: str) -> None:
    with pytest.raises(ParameterError) as refusal:
        load_regressor("learner", text)
    assert str(refusal.value) == f"learner must be {ALLOWED}, not {text!r}."


IMPORTING, MAKING = "importing Mean from own_{} fails", "making Mean, or a copy of it, fails"
TRIAL = "a trial on 100 samples fails"


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("raise RuntimeError('no\\nluck')", f"{IMPORTING}: RuntimeError: no."),
        ("raise RuntimeError('.' * 200)", rf"{IMPORTING}: RuntimeError: \.{{{{146}}}}\), not "),
        ("def f(:", f"{IMPORTING}: SyntaxError"),
        ("import sys; sys.exit('done')", f"{IMPORTING}: SystemExit: done"),
        ("class Other: pass", f"{IMPORTING}: AttributeError: .*Mean"),
        ("def Mean(): pass", f"{MAKING}: TypeError"),
        ("Mean = 3", f"{MAKING}: TypeError"),
        (f"{MEAN}\nmade = Mean\nMean = lambda size: made()", f"{MAKING}: TypeError"),
        (MEAN + "\n    def __init__(self, size):\n        self.size = size", f"{MAKING}: TypeErr"),
        (MEAN + "\n    def __init__(self, a=1):\n        self.a_ = a", f"{MAKING}: AttributeError"),
        (MEAN.replace("predict", "forecast"), f"{TRIAL}: .*predict"),
        (MEAN.replace("self.mean_ =", "raise ValueError('no fit')  #"), f"{TRIAL}: .*no fit"),
        (
            MEAN.replace("np.tile(self", "[['a']] * len(X)  # (self"),
            f"{TRIAL}: ValueError: could not convert",
        ),
        (MEAN.replace("self.mean_, (", "self.mean_ * np.nan, ("), f"{TRIAL}: .*not finite"),
        (MEAN.replace("self.mean_, (", "self.mean_ * [1, np.inf], ("), f"{TRIAL}: .*not finite"),
        (MEAN.replace("(len(X), 1)", "(3, 1)"), f"{TRIAL}: ValueError: of 5 samples"),
    ],
)
def test_a_module_that_will_not_do(
    body: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"own_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(body)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ParameterError, match=why.format(name.removeprefix("own_"))) as refusal:
        load_regressor("learner", f"{name}:Mean")
    said = str(refusal.value)
    assert said.startswith(f"learner must be {ALLOWED} (")
    assert "\n" not in said
    assert refusal.value.name == "learner"
    assert refusal.value.__suppress_context__
