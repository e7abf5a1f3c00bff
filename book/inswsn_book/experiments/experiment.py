"""What an experiment is: parameters, runs that are drawn, and methods that are judged on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from inswsn_book.parameters import Schema, Value
from inswsn_lib.evaluation import monte_carlo

Array = NDArray[np.float64]
#: Takes what was drawn and returns named results, one number a run
Judge = Callable[[Mapping[str, Array]], dict[str, Array]]


class Trial(Protocol):
    """An experiment with its parameters set, but for those that only the methods are told.

    Examples
    --------
    A coin of known bias, and the guess of whoever is told another one:

    >>> import numpy as np
    >>> from inswsn_book.experiments import Trial
    >>> class Coin:
    ...     def __init__(self, values, inputs):
    ...         self.bias = values["bias"]
    ...     def draw(self, rng, runs):
    ...         return {"heads": rng.binomial(100, self.bias, runs) / 100}
    ...     def judge(self, values):
    ...         return lambda drawn: {"guess.error": abs(drawn["heads"] - values["told"])}
    >>> coin: Trial = Coin({"bias": 0.5}, None)
    >>> drawn = coin.draw(np.random.default_rng(0), 3)
    >>> drawn["heads"].shape, sorted(coin.judge({"told": 0.4})(drawn))
    ((3,), ['guess.error'])
    """

    def draw(self, rng: np.random.Generator, runs: int) -> Mapping[str, Array]:
        """Draw a number of runs; arrays with the runs on the last axis."""
        ...

    def judge(self, values: Mapping[str, Value]) -> Judge:
        """Design the methods once, and return what judges them on drawn runs.

        Parameters
        ----------
        values : mapping of str to value
            All parameters.

        Returns
        -------
        callable
            From what `draw` returned to named results, ``"method.column"``, each (runs,).
        """
        ...


@dataclass(frozen=True)
class Experiment:
    """The Monte Carlo core of a chapter, or of a reader.

    What depends on chance is drawn by groups of runs, from streams that belong to the seed and the
    number of the group; what does not is computed once. So an experiment can be shared out to any
    number of processes, and a run is the same in all of them.

    Attributes
    ----------
    title : str
        What it is, in a few words.
    schema : Schema
        Its parameters, of which one is ``seed``; `inswsn_book.parameters.read_schema` makes it.
    begin : callable
        Takes the values of all parameters and what `load` returned, and returns a `Trial`.
    methods : mapping of str to str
        What is compared: keys and words.
    columns : mapping of str to str
        What is measured of each method: names and units.
    headline : str
        The column by which methods are ranked; less is better.
    told : frozenset of str
        Parameters that change what the methods are told and not what is drawn: cells of a sweep
        that differ in them alone share their runs.
    undrawn : frozenset of str
        Methods that a figure leaves out, since they would dwarf the others.
    files : tuple of str
        The files below ``data/`` that `load` reads.
    load : callable
        Takes the folder ``data`` and returns what `begin` needs of it, which can be pickled.

    Examples
    --------
    A mean of four numbers against their median, for a spread that is a parameter:

    >>> import numpy as np
    >>> from inswsn_book.experiments import Experiment
    >>> from inswsn_book.parameters import read_schema
    >>> class Numbers:
    ...     def __init__(self, values, inputs):
    ...         self.spread = values["spread"]
    ...     def draw(self, rng, runs):
    ...         return {"x": self.spread * rng.standard_normal((4, runs))}
    ...     def judge(self, values):
    ...         return lambda drawn: {
    ...             "mean.error": abs(drawn["x"].mean(axis=0)),
    ...             "median.error": abs(np.median(drawn["x"], axis=0)),
    ...         }
    >>> experiment = Experiment(
    ...     title="Mean against median",
    ...     schema=read_schema('''
    ... # Seed of all random numbers.
    ... seed: int = 1  # 1; in [0, inf)
    ... # Standard deviation of a number.
    ... spread: float = 2.0  # m; in (0, inf)
    ... '''),
    ...     begin=Numbers,
    ...     methods={"mean": "mean", "median": "median"},
    ...     columns={"error": "m"},
    ...     headline="error",
    ... )
    >>> experiment.quantities
    ('mean.error', 'median.error')
    >>> found = experiment.run({"spread": 3.0}, runs=2000)
    >>> bool(found["mean.error"].mean() < found["median.error"].mean())
    True
    """

    title: str
    schema: Schema
    begin: Callable[[Mapping[str, Value], Any], Trial]
    methods: Mapping[str, str]
    columns: Mapping[str, str]
    headline: str
    told: frozenset[str] = frozenset()
    undrawn: frozenset[str] = frozenset()
    files: tuple[str, ...] = ()
    load: Callable[[Path], Any] = field(default=lambda data: None)

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names of the results of a run, ``"method.column"``, in order."""
        return tuple(f"{method}.{column}" for method in self.methods for column in self.columns)

    @property
    def drawn(self) -> tuple[str, ...]:
        """The methods that a figure shows, in order."""
        return tuple(method for method in self.methods if method not in self.undrawn)

    def run(self, values: Mapping[str, Value], runs: int, inputs: Any = None) -> dict[str, Array]:
        """Run it in this process.

        Parameters
        ----------
        values : mapping of str to value
            Parameters; the others have their defaults.
        runs : int
            How many.
        inputs : object, optional
            What `load` returned.

        Returns
        -------
        dict of str to ndarray
            For each of `quantities`, (runs,).

        Raises
        ------
        ParameterError
            If a parameter is not declared, or may not have its value.
        """
        checked = self.schema.check(values)
        trial = self.begin(checked, inputs)
        judge = trial.judge(checked)
        seed = checked["seed"]
        assert isinstance(seed, int)
        return monte_carlo(lambda rng, count: judge(trial.draw(rng, count)), runs, seed)
