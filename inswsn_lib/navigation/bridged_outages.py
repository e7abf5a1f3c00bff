"""P1's two outages as a Monte Carlo: learners that stand in for the filter, tuned by rehearsal.

This is what evidence p1-outages computes over many runs, a function of its parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.dummy import DummyRegressor

from inswsn_lib import learning
from inswsn_lib.checks import Array
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.evaluation import Finding, Scores, Tuning, mean_absolute_error, monte_carlo, tune
from inswsn_lib.filters import deadbeat_gain, run_hinfinity, run_kalman
from inswsn_lib.learning import (
    LSSVMRegressor,
    RBFNetworkRegressor,
    Regressor,
    kernel_matrix,
    load_regressor,
)
from inswsn_lib.lmi import FilterDesign, design_filter
from inswsn_lib.navigation.hybrid import HybridNavigator, observable_inputs
from inswsn_lib.navigation.training_areas import (
    AREAS,
    UNKNOWN,
    ByArea,
    P1Runs,
    errors_by_area,
    first_measured,
)
from inswsn_lib.papers import AXES, COLUMNS
from inswsn_lib.scenario import Setting, with_values
from inswsn_lib.simulation import Scene

#: Inputs of a learner; with ``state`` it maps the estimate of a step to that of the next
KINDS = ("oracle", "time", "motion", "inertial", "state")
#: Runs on which tuned methods are judged, at most: a network is trained in each
MOST_JUDGED = 100
#: The filters among the methods
COASTING, HF_COASTING = "Kalman filter, coasting", "H-infinity filter, coasting"
#: The methods, with their inputs, whose shares are the headlines of the comparison
HEADLINES = (("LS-SVM", "motion"), ("BP", "motion"), (COASTING, "state"))
_TRIALS = 12
_DRAWS = 100  # of a quarter of the tuning runs
_WORST = 1e6  # a loss that is no more told apart from a larger one


@dataclass(frozen=True, eq=False)
class Passage:
    """Samples in which the network is heard, and the outage after them, in many runs or in one.

    Attributes
    ----------
    area : str
        P1's ``"1"`` or ``"2"``, or the name of a recording.
    heard : int
        Samples before the outage.
    error : ndarray, (steps, 4, runs)
        Of the INS: position and velocity, m and m/s.
    y : ndarray, (steps, 4, runs)
        INS less network; NaN in the outage.
    inputs : mapping of str to ndarray or None
        By `KINDS`, (steps, inputs, runs).
    time : ndarray, (steps,)
        s.

    Examples
    --------
    >>> from inswsn_lib.navigation import BridgedOutages
    >>> passage = BridgedOutages(runs=2).judged["1"]
    >>> passage.error.shape, passage.heard, passage.rehearsal().heard
    ((150, 4, 2), 100, 50)
    """

    area: str
    heard: int
    error: Array
    y: Array
    inputs: Mapping[str, Array | None]
    time: Array

    def run(self, number: int) -> Passage:
        """Return one of the runs, without the axis of runs."""
        inputs = {n: None if u is None else u[..., number] for n, u in self.inputs.items()}
        return replace(self, error=self.error[..., number], y=self.y[..., number], inputs=inputs)

    def rehearsal(self) -> Passage:
        """Return the samples that are heard, their second half taken for an outage.

        What was measured there stands in the place of the error, which nobody knows.
        """
        first, y = self.heard // 2, self.y[: self.heard].copy()
        y[first:] = np.nan
        inputs = {n: None if u is None else u[: self.heard] for n, u in self.inputs.items()}
        return Passage(self.area, first, self.y[: self.heard], y, inputs, self.time[: self.heard])

    def sizes(self, left: Array) -> Array:
        """Return the mean absolute remaining error and that of the INS, (2, 4, runs)."""
        return np.array([np.abs(e).mean(axis=0) for e in (left, self.error[self.heard :])])

    def shares(self, left: Array) -> Array:
        """Return the first of `sizes` over the second, (4, runs)."""
        own, alone = self.sizes(left)
        return np.asarray(own / alone)


#: A method: a passage in, the remaining error of the INS in its outage (steps, 4, runs) out
Bridge = Callable[[Passage], Array]


class Judged(NamedTuple):
    """How a method was tuned, and its shares of the error, one outage after the other.

    The tuning runs are drawn, too. What hangs on that is told by the choices of draws of a quarter
    of them. Draws of as many would hold too few of the choices of other runs where settings are
    nearly level: 87 % where these hold 93, for the LS-SVM on time.
    """

    tuning: Tuning[float]
    drawn: Array  # (1 + draws, 4 for each outage, runs), first by the tuning runs themselves

    @property
    def shares(self) -> Array:
        """Of the setting that was chosen, (4 for each outage, runs)."""
        return np.asarray(self.drawn[0])

    @property
    def by_run(self) -> Array:
        """The means over the outages, in % of the error of the INS, (1 + draws, runs)."""
        return np.asarray(100 * self.drawn.mean(axis=1))


@dataclass(frozen=True, eq=False)
class BridgedOutages(P1Runs):
    r"""P1's scene with its two outages, the hybrid of filter and learner, and its rivals.

    Every method has twelve trials and chooses by *rehearsal*: in the training areas of other runs
    the second half is taken for an outage and predicted from the first. The choice is judged in the
    outages. The Kalman filter coasts by :math:`\hat e_{k+1} = A \hat e_k`; the ratio of its Q to
    the one that matches the simulated noise is tuned. So is that of the H-infinity filter, and the
    margin of its level above the least gamma.

    Attributes
    ----------
    published : mapping of str to Setting
        The scenario files ``p1`` and ``p1-inertial``, joined.
    seed : int
        Of all random numbers.
    runs : int
        Runs of the tables; tuned methods are judged on the first `MOST_JUDGED` of them.
    tuning_runs : int
        Runs of the next seed, on whose training areas methods are tuned. With 48 both filters
        and the LS-SVM on the motion are tuned alike by ten draws of ten; with 8, by chance.
    sigma, eta : float
        Kernel width, m, and regularisation that P1 chooses.
    hidden : int
        Neurons of the network.
    range_noise, correlation_time, node_bias, inertial_scale : float
        As in `TrainingAreas`.
    learner : str
        A scikit-learn regressor, ``package.module:Class``; it takes part as it is made.

    Examples
    --------
    >>> from inswsn_lib.navigation import BridgedOutages
    >>> outages = BridgedOutages(runs=2, inertial_scale=2.0)
    >>> passage = outages.judged["2"]
    >>> left = outages.bridge(passage, outages.printed, "oracle", scaled=False)
    >>> left.shape
    (50, 4, 2)
    """

    runs: int = 256
    tuning_runs: int = 48
    sigma: float = 1000.0
    eta: float = 1000.0
    hidden: int = 10
    learner: str = "sklearn.linear_model:LinearRegression"

    @cached_property
    def drawn(self) -> dict[str, Array]:
        """What `Scene.simulate` gives in the runs of the tables."""
        return monte_carlo(self.scene.simulate, self.runs, self.seed)

    @cached_property
    def others(self) -> dict[str, Array]:
        """The same in the runs on which methods are tuned."""
        return monte_carlo(self.scene.simulate, self.tuning_runs, self.seed + 1)

    def passages(self, drawn: Mapping[str, Array]) -> dict[str, Passage]:
        """Return each area and the outage after it, from what `Scene.simulate` gives."""
        return {a: self.passage(drawn, a) for a in AREAS}

    def passage(self, drawn: Mapping[str, Array], area: str, scene: Scene | None = None) -> Passage:
        """Return an area and the outage after it; of another scene with the same area if given."""
        scene = scene or self.scene
        names, heard = (f"area{area}", f"outage{area}"), scene.training_samples
        error = np.concatenate([drawn[f"ins.{name}"] for name in names])
        gap = np.full_like(error[heard:], np.nan)
        y = np.concatenate([error[:heard] - drawn[f"wsn.{names[0]}"], gap])
        if lost := int(np.isnan(y[:heard]).any(axis=(1, 2)).sum()):
            got = Described(f"one without at {lost} of {heard} in area {area}")
            raise ParameterError(
                "scene", got, "one with a fix at each sample that teaches learners"
            )
        time = np.concatenate([scene.windows[name].times for name in names])
        drive = scene.path.drive(scene.speed, time)
        truth = np.hstack([drive.position, drive.velocity])[:, :, None]
        inputs = observable_inputs(time, truth + error) | {"oracle": error, "state": None}
        return Passage(area, heard, error, y, inputs, time)

    @cached_property
    def judged(self) -> dict[str, Passage]:
        """The passages on which tuned methods are judged."""
        few = min(self.runs, MOST_JUDGED)
        return self.passages({name: values[..., :few] for name, values in self.drawn.items()})

    @cached_property
    def rehearsals(self) -> list[Passage]:
        """The rehearsals of both areas, in the runs on which methods are tuned."""
        return [passage.rehearsal() for passage in self.passages(self.others).values()]

    @property
    def _fitted_to(self) -> Mapping[str, ByArea]:
        return errors_by_area(self.others)

    def coasting(self, area: str, ratio: float) -> Callable[[Array], Array]:
        """Return a Kalman filter that assumes Q to be this many times the one that matches."""
        model = self.assuming(ratio)[area]
        return lambda y: run_kalman(model, y, initial_covariance=UNKNOWN)

    def coasting_hf(self, area: str, ratio: float, margin: float) -> Callable[[Array], Array]:
        """Return an H-infinity filter of the exact inequality, with the same Q, and its margin."""
        design = self._design(area, ratio, margin)
        return lambda y: run_hinfinity(design, y, initial_state=first_measured(y))

    @cached_property
    def _design(self) -> Callable[[str, float, float], FilterDesign]:
        """What makes an H-infinity filter, once: each is tried on many passages."""
        return cache(lambda a, ratio, margin: design_filter(self.assuming(ratio)[a], margin=margin))

    @cached_property
    def printed(self) -> LSSVMRegressor:
        """The LS-SVM with the kernel width and the regularisation that P1 prints."""
        return LSSVMRegressor(self.sigma, self.eta)

    @cached_property
    def toolbox(self) -> Any:
        """The network that a toolbox of 2011 makes by default."""
        return learning.BackpropRegressor(
            hidden=self.hidden, trainer="levenberg-marquardt", scaling="range",
            validation_share=0.15, epochs=100, random_state=10_000 * self.seed,
        )  # fmt: skip

    @cached_property
    def own(self) -> Any:
        """The regressor of the parameter `learner`, as it is made."""
        return load_regressor("learner", self.learner, seed=self.seed)

    def navigator(self, area: str, regressor: Any, kind: str, **options: Any) -> HybridNavigator:
        """Return the hybrid of P1's filter, its gain as printed, and a regressor on some inputs."""
        published = partial(self._published, area)
        return HybridNavigator(published, regressor, feedback=kind == "state", **options)

    def _published(self, area: str, y: Array) -> Array:
        """Return what P1's filter makes of measurements."""
        model, start = self.models[area], first_measured(y)
        gain = deadbeat_gain(model)
        return run_hinfinity((model, gain), y, initial_state=start, predicted=False)

    @cached_property
    def _filtered(self) -> Callable[[Passage], Array]:
        """What P1's filter makes of a passage, once: every regressor needs it."""
        return lru_cache(8)(lambda passage: self._published(passage.area, passage.y))

    def bridge(self, passage: Passage, regressor: Any, kind: str, **options: Any) -> Array:
        """Return the remaining error of the INS in the outage by the hybrid, (steps, 4, runs)."""
        filtered = self._filtered(passage)
        hybrid = self.navigator(passage.area, regressor, kind, **options)
        hybrid.filter = lambda _: filtered
        ran = hybrid.run(passage.y, passage.inputs[kind])
        return np.asarray((passage.error - ran.estimates)[passage.heard :])

    def coast(self, passage: Passage, ratio: float, margin: float | None = None) -> Array:
        """Return the remaining error in the outage by a coasting filter, (steps, 4, runs).

        It is the H-infinity filter where a margin is given, else the Kalman filter.
        """
        if margin is None:
            estimates = self.coasting(passage.area, ratio)(passage.y)
        else:
            estimates = self.coasting_hf(passage.area, ratio, margin)(passage.y)
        return np.asarray((passage.error - estimates)[passage.heard :])

    @cached_property
    def fits(self) -> dict[str, tuple[Any, list[int]]]:
        """What fits the last fixes alone, regressors on time with the numbers of fixes."""
        lasts = [2, 4, 6, 8, 12, 16, 20, 25, 30, 35, 40, 50]
        return {
            "mean of the last fixes": (
                DummyRegressor(), [1, 2, 3, 4, 6, 8, 12, 16, 20, 30, 40, 50],
            ),
            "line in time": (_Polynomial(1), lasts),
            "parabola in time": (_Polynomial(2), [n + 2 for n in lasts]),
        }  # fmt: skip

    @cached_property
    def learners(self) -> dict[str, list[Any]]:
        """The settings of each learner that are tried."""

        def network(hidden: int, decay: float) -> Any:
            return learning.BackpropRegressor(
                hidden=hidden, weight_decay=decay, scaling="none",
                validation_share=0.15, epochs=50, random_state=10_000 * self.seed,
            )  # fmt: skip

        widths, noises = [1, 10, 100, 1000], [1e2, 1e4, 1e6]
        return {
            "LS-SVM": [LSSVMRegressor(*each) for each in product(widths, noises)],
            "LS-SVM, linear kernel": [
                LSSVMRegressor(1.0, s, "linear") for s in np.logspace(-3, 2.5, _TRIALS)
            ],
            "BP": [network(*each) for each in product([2, 5, 10], [0, 1e-4, 1e-3, 1e-2])],
            "RBF network": [
                RBFNetworkRegressor(s, max_neurons=n)
                for s, n in product([1, 3, 10, 30], [3, 6, 12])
            ],
            "Gaussian process": [
                _GaussianProcess(*each) for each in product([0.3, 1, 3, 10], [0.03, 0.1, 0.3])
            ],
        }

    def methods(self, kinds: Iterable[str]) -> dict[tuple[str, str], list[Bridge]]:
        """Return the settings that are tried, by method and kind of input.

        Each takes a passage and returns the remaining error of the INS in its outage.
        """
        found: dict[tuple[str, str], list[Bridge]] = {}
        for name, (regressor, lasts) in self.fits.items():
            found[name, "time"] = [
                partial(self.bridge, regressor=regressor, kind="time", window=last, least=1)
                for last in lasts
            ]
        for (name, machines), kind in product(self.learners.items(), kinds):
            found[name, kind] = [partial(self.bridge, regressor=m, kind=kind) for m in machines]
        ratios = np.logspace(-4, 4, _TRIALS)
        both = product([0.01, 1.0, 100.0, 1e4], [0.01, 0.5, 5.0])
        return found | {
            (COASTING, "state"): [partial(self.coast, ratio=r) for r in ratios],
            (HF_COASTING, "state"): [partial(self.coast, ratio=r, margin=g) for r, g in both],
        }

    def compare(
        self, passages: Sequence[Passage], rehearsals: Sequence[Passage], kinds: Iterable[str]
    ) -> dict[tuple[str, str], Judged]:
        """Tune every method by rehearsal, with equal trials, and judge it: by method and input."""
        return {
            (name, kind): judge_best(name, bridges, passages, rehearsals)
            for (name, kind), bridges in self.methods(kinds).items()
        }

    def judge(
        self, passages: Iterable[Passage], regressor: Any, kind: str, **options: Any
    ) -> Array:
        """Return a regressor's shares of the error, one outage after the other."""
        return _shares(passages, partial(self.bridge, regressor=regressor, kind=kind, **options))

    def scores(self) -> Scores:
        """Return Table 3 with equal terms: each method on the motion, and what needs no input.

        The cells are mean absolute errors over an outage; ``left`` is the remaining share of the
        error of the INS, mean over the cells.
        """
        passages = list(self.judged.values())
        compared = self.compare(passages, self.rehearsals, ("motion",))
        shares = {name: entry.shares for (name, _), entry in compared.items()} | {
            "printed": self.judge(passages, self.printed, "motion", scaled=False),
            "toolbox": self.judge(passages, self.toolbox, "motion", scaled=False),
            "own": self.judge(passages, self.own, "motion"),
            "ins": np.concatenate([p.shares(p.error[p.heard :]) for p in passages]),
        }
        alone = np.concatenate([mean_absolute_error(p.error[p.heard :]) for p in passages])
        cells = [axis + a for a in AREAS for axis in AXES]
        values: dict[str, Array] = {}
        for name, share in shares.items():
            left = zip(cells, share * alone, strict=True)
            values |= {f"{_slug(name)}.{cell}": errors for cell, errors in left}
            values[f"{_slug(name)}.left"] = share.mean(axis=0)
        labels = {name: name for name in shares} | {
            "ins": "INS alone",
            "own": self.learner,
            "printed": "LS-SVM as printed",
            "toolbox": "BP of a toolbox",
        }
        units = {c: "m" if c[0] == "r" else "m/s" for c in COLUMNS}
        return Scores(
            findings=share_findings({key: compared[key] for key in HEADLINES}),
            methods={_slug(name): label for name, label in labels.items()},
            columns=units | {"left": "1"},
            values=values,
            headline="left",
            baselines=frozenset({"ins"}),
        )


def judge_best(
    name: str, bridges: Sequence[Bridge], passages: Sequence[Passage], rehearsals: Sequence[Passage]
) -> Judged:
    """Choose among the settings of a method by rehearsal, and judge the choice in passages."""
    sizes = np.array([[of.sizes(bridge(of)) for of in rehearsals] for bridge in bridges])
    runs = sizes.shape[-1]

    def losses(tuned_on: NDArray[np.int64]) -> Array:
        left, alone = np.moveaxis(sizes[..., tuned_on].mean(axis=-1), 2, 0)
        return np.asarray(np.minimum((left / alone).mean(axis=(1, 2)), _WORST))

    given = losses(np.arange(runs))
    tuning = tune(name, range(len(bridges)), lambda place: given[int(place)])
    others = np.random.default_rng(runs).integers(runs, size=(_DRAWS, max(runs // 4, 1)))
    chosen = [int(tuning.best), *(int(losses(draw).argmin()) for draw in others)]
    shares = {place: _shares(passages, bridges[place]) for place in set(chosen)}
    return Judged(tuning, np.array([shares[place] for place in chosen]))


def share_findings(compared: Mapping[tuple[str, str], Judged]) -> dict[str, Finding]:
    """Return what is left of the error of the INS by method and input, in %.

    The names are ``fair.METHOD.INPUT``, as in ``fair.ls-svm.motion``.
    """
    how = "Remaining error over that of INS-only in the outages, mean over the eight columns, "
    return {
        f"fair.{_slug(name)}.{kind}": Finding.of_runs(
            entry.by_run, "%", f"{how}median over runs: {name}, {kind}."
        )
        for (name, kind), entry in compared.items()
    }


def _shares(passages: Iterable[Passage], bridge: Bridge) -> Array:
    """Return a method's shares of the error, one outage after the other."""
    return np.concatenate([passage.shares(bridge(passage)) for passage in passages])


@dataclass(eq=False, repr=False)
class _Polynomial(Regressor):
    """Least squares by powers of the one input, as scikit-learn's, which checks more."""

    _learnt = ("middle_", "centre_", "slopes_")

    degree: int

    def _fit(self, X: Array, Y: Array) -> None:
        powers, self.middle_ = self._powers(X), Y.mean(axis=0)
        self.centre_: Array = powers.mean(axis=0)
        self.slopes_ = np.linalg.lstsq(powers - self.centre_, Y - self.middle_, rcond=None)[0]

    def _predict(self, X: Array) -> Array:
        return np.asarray((self._powers(X) - self.centre_) @ self.slopes_ + self.middle_)

    def _powers(self, X: Array) -> Array:
        return np.asarray(X ** np.arange(1, self.degree + 1))


@dataclass(eq=False, repr=False)
class _GaussianProcess(Regressor):
    r"""A Gaussian process of mean zero with a fixed kernel, as scikit-learn's, which checks more.

    The kernel is :math:`1 + x'z + \exp(-|x - z|^2 / 2 l^2)`, and the noise is white.
    """

    _learnt = ("X_fit_", "alpha_")

    length: float
    deviation: float

    def _fit(self, X: Array, Y: Array) -> None:
        K = self._covariances(X, X)
        K.ravel()[:: len(X) + 1] += self.deviation**2 + 1e-10  # which scikit-learn adds, too
        self.alpha_, self.X_fit_ = np.linalg.solve(K, Y), X

    def _predict(self, X: Array) -> Array:
        return np.asarray(self._covariances(X, self.X_fit_) @ self.alpha_)

    def _covariances(self, X: Array, Z: Array) -> Array:
        return np.asarray(kernel_matrix(X, Z, "rbf", self.length, 1) + X @ Z.mT + 1)


def _slug(name: str) -> str:
    return name.lower().replace(", ", "-").replace(" ", "-")


def with_outage(settings: Mapping[str, Setting], samples: int) -> dict[str, Setting]:
    """Return the settings of P1's scene with outages of so many samples, both areas where they are.

    Parameters
    ----------
    settings : mapping of str to Setting
        The scenario files ``p1`` and ``p1-inertial``, joined.
    samples : int

    Examples
    --------
    >>> from inswsn_lib.navigation import BridgedOutages, with_outage
    >>> outages = [BridgedOutages(with_outage(BridgedOutages().published, n)) for n in (50, 100)]
    >>> [round(each.scene.windows["area2"].start, 3) for each in outages]
    [61.3, 61.3]
    """
    longer = (samples - settings["outage_samples"].value) * settings["periods"].value[0]
    between = settings["between"].value - longer
    return with_values(settings, outage_samples=samples, between=between)
