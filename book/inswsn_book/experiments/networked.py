"""Chapter 02 as an experiment: P1's scene with a network, over periods and told noise."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inswsn_book.experiments.experiment import Experiment, Judge
from inswsn_book.parameters import Value, read_schema
from inswsn_lib.evaluation import NoiseFit, fit_noise, mean_absolute_error, monte_carlo
from inswsn_lib.filters import deadbeat_gain, run_hinfinity, run_kalman
from inswsn_lib.lmi import design_filter
from inswsn_lib.models import ErrorModel
from inswsn_lib.papers import AXES, COLUMNS
from inswsn_lib.simulation import Scene, Setting, load_scenario, with_values

Array = NDArray[np.float64]

_PARAMETERS = """
# Seed of all random numbers.
seed: int = 2012  # 1; in [0, 1000000]
# Sampling period in the first area and in the outage after it; that of the second keeps its
# ratio to it, 0.21 / 0.2. P1 says 1 s; its matrices print 0.2. The speed is such that the node
# drives the same path in the same samples.
period: float = 0.2  # s; in [0.01, 2]
# Factor on the Q that the filters are told, over the one that matches the simulation.
q_scale: float = 1.0  # 1; in [1e-8, 1e8]
# Runs from which noise figures are fitted, others than those that are judged.
other_runs: int = 256  # runs; in [40, 5000]
# Standard deviation of a range.
range_noise: float = 0.38  # m; in [0.02, 2]
# Standard deviation of a velocity of the network, each component.
velocity_noise: float = 0.126  # m/s; in [0.01, 2]
# Velocity random walk of the accelerometers.
accelerometer_noise: float = 0.005  # m/s/s^0.5; in [0, 1]
# Angle random walk of the gyro.
gyro_noise: float = 0.0005  # rad/s^0.5; in [0, 0.1]
# Factor on all fitted errors of the inertial sensors; 1 takes them as fitted.
inertial_scale: float = 1.0  # 1; in [0.1, 10]
"""

_FILES = ("scenarios/p1.yaml", "scenarios/p1-inertial.yaml")
_AREAS = "12"
# the Kalman filters start from the first measurement
_UNKNOWN = 1e6 * np.eye(4)
_METHODS = {
    "ins": "INS alone",
    "network": "network alone = published HF, filtered",
    "kf": "KF, filtered",
    "hf-exact": "HF, exact LMI, filtered",
    "hf-printed": "HF, printed LMI, filtered",
    "hf-published": "published HF, predicted",
}


class NetworkedTrial:
    r"""P1's scene at some period, and the filters of chapter 02 on it.

    A cell is the mean absolute error of a run over the samples of an area, as in P1's Table 2.
    ``position`` and ``velocity`` are the means of the four cells each. The filters are told one
    standard deviation for position and one for velocity of Q and of R, fitted to other runs
    (`inswsn_lib.evaluation.fit_noise`), with Q multiplied by ``q_scale``.

    **What is held when the period changes.** The path sample by sample: the speed goes with one
    over the period, and the times before and between the areas with the period, so that each
    sample stays where it was. The inertial sensors are sampled 20 times a period. The errors of the
    sensors keep their values in SI units, and so do the start of the INS, the noise of the network
    and the jitter. So an INS drifts for five times as long at 1 s as at 0.2 s, and its errors were
    fitted to P1's table at 0.2 s only.

    Parameters
    ----------
    values : mapping of str to value
        The parameters of the experiment; ``q_scale`` is not used here.
    settings : mapping of str to Setting
        ``p1.yaml`` and ``p1-inertial.yaml``.

    Examples
    --------
    At 1 s the node walks, and the area begins at the same place of the path:

    >>> from inswsn_book.project import find_root
    >>> from inswsn_book.experiments.networked import NETWORKED, NetworkedTrial
    >>> settings = NETWORKED.load(find_root() / "data")
    >>> trials = {
    ...     period: NetworkedTrial(NETWORKED.schema.check({"period": period}), settings)
    ...     for period in (0.2, 1.0)
    ... }
    >>> for trial in trials.values():
    ...     scene = trial.scene
    ...     print(scene.speed, scene.windows["area1"].samples, round(scene.speed * scene.lead, 6))
    7.5 100 130.8
    1.5 100 130.8
    """

    def __init__(self, values: Mapping[str, Value], settings: Mapping[str, Setting]) -> None:
        self._values = dict(values)
        self.scene = _scene(values, settings)

    def draw(self, rng: np.random.Generator, runs: int) -> dict[str, Array]:
        """Draw the errors of INS and network in both areas.

        Parameters
        ----------
        rng : numpy.random.Generator
            The stream.
        runs : int
            How many.

        Returns
        -------
        dict of str to ndarray
            As `inswsn_lib.simulation.Scene.simulate`.
        """
        return self.scene.simulate(rng, runs)

    @cached_property
    def noise(self) -> dict[str, NoiseFit]:
        """Q and R of each area, fitted to runs that belong to the next seed."""
        runs, seed = self._values["other_runs"], self._values["seed"]
        assert isinstance(runs, int)
        assert isinstance(seed, int)
        others = monte_carlo(self.scene.simulate, runs, seed + 1)
        return {
            a: fit_noise(model.A, others[f"ins.area{a}"], others[f"wsn.area{a}"])
            for a, model in self._plain.items()
        }

    @property
    def _plain(self) -> dict[str, ErrorModel]:
        return {
            a: ErrorModel.p1(period) for a, period in zip(_AREAS, self.scene.periods, strict=True)
        }

    def judge(self, values: Mapping[str, Value]) -> Judge:
        """Design the filters, and return what runs them.

        Parameters
        ----------
        values : mapping of str to value
            The parameters, of which ``q_scale`` is used.

        Returns
        -------
        callable
            From what `draw` returned to the cells of each run.

        Raises
        ------
        InfeasibleDesignError
            If an H-infinity filter cannot be designed.
        """
        scale = values["q_scale"]
        assert isinstance(scale, float)
        told = {
            a: ErrorModel.p1(
                model.period,
                process_noise=_sizes(scale * self.noise[a].process),
                measurement_noise=_sizes(self.noise[a].measurement),
            )
            for a, model in self._plain.items()
        }
        designs = {
            form: {a: design_filter(model, form) for a, model in told.items()}
            for form in ("exact", "printed")
        }
        deadbeat = {a: (model, deadbeat_gain(model)) for a, model in self._plain.items()}

        def judged(drawn: Mapping[str, Array]) -> dict[str, Array]:
            found: dict[str, dict[str, Array]] = {method: {} for method in _METHODS}
            for a in _AREAS:
                ins, network = drawn[f"ins.area{a}"], drawn[f"wsn.area{a}"]
                y = ins - network
                start = np.nan_to_num(y[0])
                errors = {
                    "ins": ins,
                    "network": network,
                    "kf": ins - run_kalman(told[a], y, initial_covariance=_UNKNOWN),
                    "hf-exact": ins
                    - run_hinfinity(designs["exact"][a], y, initial_state=start, predicted=False),
                    "hf-printed": ins
                    - run_hinfinity(designs["printed"][a], y, initial_state=start, predicted=False),
                    # there is no prediction of the first step
                    "hf-published": (ins - run_hinfinity(deadbeat[a], y, initial_state=start))[1:],
                }
                for method, error in errors.items():
                    means = mean_absolute_error(error)
                    found[method] |= {
                        axis + a: mean for axis, mean in zip(AXES, means, strict=True)
                    }
            return {
                f"{method}.{column}": values
                for method, cells in found.items()
                for column, values in _with_means(cells).items()
            }

        return judged


def _scene(values: Mapping[str, Value], settings: Mapping[str, Setting]) -> Scene:
    """Return the scene at a period: the same path in the same samples."""
    first, second = np.asarray(settings["periods"].value, dtype=float)
    period = values["period"]
    assert isinstance(period, float)
    slower = period / first
    inertial = ("accelerometer_bias", "accelerometer_scale", "gyro_bias", "heading", "velocity")
    return Scene.from_settings(
        with_values(
            settings,
            periods=[period, second * slower],
            speed=settings["speed"].value / slower,
            lead=settings["lead"].value * slower,
            between=settings["between"].value * slower,
            inertial_interval=settings["inertial_interval"].value * slower,
            noise=values["range_noise"],
            velocity_noise=values["velocity_noise"],
            accelerometer_noise=values["accelerometer_noise"],
            gyro_noise=values["gyro_noise"],
            **{
                name: np.multiply(settings[name].value, values["inertial_scale"])
                for name in (*inertial, "position")
            },
        )
    )


def _sizes(moment: Array) -> tuple[float, float]:
    """Return one standard deviation for position and one for velocity."""
    position, velocity = np.sqrt(np.diag(moment).reshape(2, 2).mean(axis=1))
    return float(position), float(velocity)


def _with_means(cells: Mapping[str, Array]) -> dict[str, Array]:
    """Return the cells of a method in P1's order, and the means over position and velocity."""
    means = {
        name: np.asarray(np.mean([cells[c] for c in COLUMNS if c[0] == kind], axis=0))
        for name, kind in (("position", "r"), ("velocity", "v"))
    }
    return {c: cells[c] for c in COLUMNS} | means


def _load(data: Path) -> dict[str, Setting]:
    first, second = (load_scenario(data / name) for name in _FILES)
    return first | second


#: The experiment of chapter 02
NETWORKED = Experiment(
    title="P1's scene while a network is heard",
    schema=read_schema(_PARAMETERS),
    begin=NetworkedTrial,
    methods=_METHODS,
    columns={c: "m" if c[0] == "r" else "m/s" for c in COLUMNS}
    | {"position": "m", "velocity": "m/s"},
    headline="position",
    told=frozenset({"q_scale"}),
    undrawn=frozenset({"ins"}),
    files=_FILES,
    load=_load,
)
