"""A reader's own regressor: named by module and class, and tried before anything runs."""

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
#: What such a parameter may be
ALLOWED = "package.module:Class, a scikit-learn regressor that needs no arguments"

_FORM = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*):([A-Za-z_]\w*)")


def load_regressor(name: str, text: str, *, seed: int = 0) -> Any:
    """Return the regressor that a text names, made without arguments, for several outputs.

    It is tried on 100 samples with four inputs and two outputs. If it takes one output only, it is
    copied for each: it comes in scikit-learn's ``MultiOutputRegressor``.

    Parameters
    ----------
    name : str
        Of the parameter, for the sentence of a refusal.
    text : str
        ``package.module:Class``; the module is installed or lies in the working folder.
    seed : int
        The random state, if it has one.

    Raises
    ------
    ParameterError
        If the text has another form, there is no such module or class, it cannot be made without
        arguments, or the trial fails.

    Examples
    --------
    A linear fit takes any number of outputs; scikit-learn's support vector machine takes one.

    >>> from inswsn_lib.learning import load_regressor
    >>> load_regressor("learner", "sklearn.linear_model:LinearRegression")
    LinearRegression()
    >>> load_regressor("learner", "sklearn.svm:SVR")
    MultiOutputRegressor(estimator=SVR())
    """
    if not (parts := _FORM.fullmatch(text)):
        raise ParameterError(name, text, ALLOWED)
    module, class_name = parts.groups()
    folder = os.environ.get(MODULES_VARIABLE, str(Path.cwd()))
    if folder not in sys.path:
        sys.path.append(folder)
    doing = f"importing {class_name} from {module}"
    try:
        found = getattr(importlib.import_module(module), class_name)
        doing = f"making {class_name}, or a copy of it,"
        machine = clone(found())
        if "random_state" in machine.get_params():
            machine.set_params(random_state=seed)
        doing = "a trial on 100 samples"
        if not _takes_several(machine):
            machine = MultiOutputRegressor(machine)
        out = _trial(machine)
        if out.shape != (5, 2) or not np.isfinite(out).all():
            raise ValueError(f"of 5 samples it predicts {out.shape}, or what is not finite")
    except (Exception, SystemExit) as error:  # a script may end with sys.exit
        told = f"{type(error).__name__}: {error}".splitlines()[0][:160]
        raise ParameterError(name, text, f"{ALLOWED}; {doing} fails: {told}") from None
    return machine


def _trial(machine: Any) -> Array:
    """Fit a clone on 100 samples with four inputs and two outputs; return what it says of five."""
    X = np.random.default_rng(0).normal(size=(100, 4))
    return np.asarray(clone(machine).fit(X, X[:, :2]).predict(X[:5]), dtype=float)


def _takes_several(machine: Any) -> bool:
    with suppress(Exception):
        return _trial(machine).shape == (5, 2)
    return False
