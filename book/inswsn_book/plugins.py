"""What a reader brings along, named by module and name, and tried before anything runs."""

from __future__ import annotations

import importlib
import os
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

from inswsn_book.project import MODULES_VARIABLE
from inswsn_lib.errors import ParameterError

_FORM = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")

#: What such a parameter may be
ALLOWED = "package.module:Class, a scikit-learn regressor that needs no arguments"


def import_object(name: str, text: str, allowed: str, kind: type) -> Any:
    """Return the object that a text names by its module and its name in it.

    Parameters
    ----------
    text : str
        ``package.module:Name``; the module is installed or lies in the working folder.

    Raises
    ------
    ParameterError
        If the text has another form, or there is no such module or object.
    """
    if not _FORM.fullmatch(text):
        raise ParameterError(name, text, allowed)
    module_name, _, object_name = text.partition(":")
    folder = os.environ.get(MODULES_VARIABLE, str(Path.cwd()))
    if folder not in sys.path:
        sys.path.append(folder)
    try:
        found = getattr(importlib.import_module(module_name), object_name, None)
    except (Exception, SystemExit) as error:  # a script that ends with sys.exit
        why = f"importing {module_name} fails: {_short(error)}"
        raise ParameterError(name, text, f"{allowed}; {why}") from None
    if not isinstance(found, kind):
        what = "class" if kind is type else kind.__name__
        why = f"{module_name} has no {what} {object_name}"
        raise ParameterError(name, text, f"{allowed}; {why}")
    return found


def load_regressor(name: str, text: str) -> Any:
    """Return an instance of the regressor class that a text names.

    The class is made without arguments and tried on 100 samples with four inputs.

    Parameters
    ----------
    text : str
        ``package.module:Class``; the module is installed or lies in the working folder.

    Raises
    ------
    ParameterError
        If the text has another form, there is no such module or class, it cannot be made without
        arguments, or the trial fails.
    """
    found = import_object(name, text, ALLOWED, type)
    class_name = text.partition(":")[2]

    def refused(why: str) -> ParameterError:
        return ParameterError(name, text, f"{ALLOWED}; {why}")

    if not all(hasattr(found, method) for method in ("fit", "predict", "get_params")):
        raise refused(f"{class_name} lacks one of fit, predict and get_params")
    try:
        machine = found()
        found(**machine.get_params(deep=False))  # as scikit-learn copies it
    except Exception as error:
        raise refused(f"making it, or a copy of it, fails: {_short(error)}") from None
    rng = np.random.default_rng(0)
    X = rng.normal(size=(100, 4))
    try:
        out = np.asarray(found().fit(X, X @ [1.0, 2.0, 3.0, 4.0]).predict(X[:2]), dtype=float)
    except Exception as error:
        raise refused(f"a trial on 100 samples fails: {_short(error)}") from None
    if out.shape not in ((2,), (2, 1)) or not np.isfinite(out).all():
        raise refused(f"in a trial it predicts {out.shape}, or numbers that are not finite")
    return machine


def _short(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0][:160]
