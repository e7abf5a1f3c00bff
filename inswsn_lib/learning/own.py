"""A reader's own regressor: named by its module and name, and tried before anything runs."""

from __future__ import annotations

import importlib
import os
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.multioutput import MultiOutputRegressor

from inswsn_lib.checks import Array
from inswsn_lib.errors import ParameterError

#: Names the folder in which a reader's own modules are looked for; by default the working folder.
MODULES_VARIABLE = "INSWSN_MODULES"
#: What such a parameter must be
ALLOWED = (
    "the package.module:name of a scikit-learn regressor: a class or function called without "
    "arguments, or an instance such as a pipeline"
)

_FORM = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*):([A-Za-z_]\w*)")


def load_regressor(name: str, text: str, *, seed: int = 0) -> Any:
    """Return the regressor that a text names, for several outputs.

    It is tried on 100 samples with four inputs and two outputs. If it takes one output only, it is
    copied for each: it comes in scikit-learn's ``MultiOutputRegressor``.

    Parameters
    ----------
    name : str
        Of the parameter, for the sentence of a refusal.
    text : str
        ``package.module:name``; the module is installed or lies in the working folder. It names a
        class, or a function, which is called without arguments, or an instance, which is copied.
    seed : int
        The random state, where it has one that is not set.

    Raises
    ------
    ParameterError
        If the text has another form, there is no such module or name, it cannot be made without
        arguments, or the trial fails.

    Examples
    --------
    A linear fit takes any number of outputs; scikit-learn's support vector machine takes one.

    >>> from inswsn_lib.learning import load_regressor
    >>> load_regressor("learner", "sklearn.linear_model:LinearRegression")
    LinearRegression()
    >>> load_regressor("learner", "sklearn.svm:SVR")
    MultiOutputRegressor(estimator=SVR())

    One with arguments is an instance in a module of your own, say ``mine.py`` with the line
    ``ridge = Ridge(alpha=10)``, named ``mine:ridge``.
    """
    if not (parts := _FORM.fullmatch(text)):
        raise ParameterError(name, text, ALLOWED)
    module, attribute = parts.groups()
    folder = os.environ.get(MODULES_VARIABLE, str(Path.cwd()))
    if folder not in sys.path:
        sys.path.append(folder)
    doing = f"importing {attribute} from {module}"
    try:
        found = getattr(importlib.import_module(module), attribute)
        doing = f"making {attribute}, or a copy of it,"
        # an instance may be callable, and a class has a method fit as well
        instance = hasattr(found, "fit") and not isinstance(found, type)
        machine = clone(found if instance else found())
        chances = [
            name
            for name, value in machine.get_params().items()
            if name.rpartition("__")[2] == "random_state" and value is None
        ]
        machine.set_params(**dict.fromkeys(chances, seed))
        doing = "a trial on 100 samples"
        if not _takes_several(machine):
            machine = MultiOutputRegressor(machine)
        out = _trial(machine)
        if out.shape != (5, 2) or not np.isfinite(out).all():
            raise ValueError(f"of 5 samples it predicts {out.shape}, or what is not finite")
    except (Exception, SystemExit) as error:  # a script may end with sys.exit
        told = f"{type(error).__name__}: {error}".splitlines()[0][:160]
        raise ParameterError(name, text, f"{ALLOWED} ({doing} fails: {told})") from None
    return machine


def _trial(machine: Any) -> Array:
    """Fit a clone on 100 samples with four inputs and two outputs; return what it says of five."""
    X = np.random.default_rng(0).normal(size=(100, 4))
    return np.asarray(clone(machine).fit(X, X[:, :2]).predict(X[:5]), dtype=float)


def _takes_several(machine: Any) -> bool:
    with suppress(Exception):
        return _trial(machine).shape == (5, 2)
    return False
