"""A reader's own regressor, named by module and class, and tried before anything runs."""

from __future__ import annotations

import importlib
import os
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

from inswsn_lib.errors import ParameterError

#: Names the folder in which a reader's own modules are looked for; by default the working folder.
MODULES_VARIABLE = "INSWSN_MODULES"
#: What such a parameter may be
ALLOWED = "package.module:Class, a scikit-learn regressor that needs no arguments"

_FORM = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def load_regressor(name: str, text: str) -> Any:
    """Return an instance of the regressor class that a text names.

    The class is made without arguments and tried on 100 samples with four inputs.

    Parameters
    ----------
    name : str
        Of the parameter, for the sentence of a refusal.
    text : str
        ``package.module:Class``; the module is installed or lies in the working folder.

    Raises
    ------
    ParameterError
        If the text has another form, there is no such module or class, it cannot be made without
        arguments, or the trial fails.

    Examples
    --------
    >>> from inswsn_lib.learning import load_regressor
    >>> load_regressor("learner", "sklearn.linear_model:LinearRegression")
    LinearRegression()
    """

    def refused(why: str) -> ParameterError:
        return ParameterError(name, text, f"{ALLOWED}; {why}")

    if not _FORM.fullmatch(text):
        raise ParameterError(name, text, ALLOWED)
    module_name, _, class_name = text.partition(":")
    folder = os.environ.get(MODULES_VARIABLE, str(Path.cwd()))
    if folder not in sys.path:
        sys.path.append(folder)
    try:
        found = getattr(importlib.import_module(module_name), class_name, None)
    except (Exception, SystemExit) as error:  # a script that ends with sys.exit
        raise refused(f"importing {module_name} fails: {_short(error)}") from None
    if not isinstance(found, type):
        raise refused(f"{module_name} has no class {class_name}")
    if not all(hasattr(found, method) for method in ("fit", "predict", "get_params")):
        raise refused(f"{class_name} lacks one of fit, predict and get_params")
    try:
        machine = found()
        found(**machine.get_params(deep=False))  # as scikit-learn copies it
    except Exception as error:
        raise refused(f"making it, or a copy of it, fails: {_short(error)}") from None
    X = np.random.default_rng(0).normal(size=(100, 4))
    try:
        out = np.asarray(found().fit(X, X @ [1.0, 2.0, 3.0, 4.0]).predict(X[:2]), dtype=float)
    except Exception as error:
        raise refused(f"a trial on 100 samples fails: {_short(error)}") from None
    if out.shape not in ((2,), (2, 1)) or not np.isfinite(out).all():
        raise refused(f"in a trial it predicts {out.shape}, or numbers that are not finite")
    return machine


def _short(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0][:160]
