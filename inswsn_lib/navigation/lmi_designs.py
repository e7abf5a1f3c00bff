"""P1's filters by its inequality and by the exact one: what the slip costs, what each filter gains.

This is what evidence p1-lmi finds, a function of its parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import get_args

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding
from inswsn_lib.filters import predictor_gain, steady_error
from inswsn_lib.lmi import design_filter, hinf_norm
from inswsn_lib.lmi.designs import Form, Solver
from inswsn_lib.models import ErrorModel


@dataclass(frozen=True, eq=False)
class LMIDesigns:
    r"""The designs for P1's error model, with the jitter left out; chance has no part in them.

    Attributes
    ----------
    period : float
        Sampling period, s.
    process_noise, measurement_noise : float
        Standard deviations of a step, position (m) and velocity (m/s) alike.
    margin : float
        The filter is designed for a :math:`\gamma` this share above the least one.
    solver : {"clarabel", "scs"}
        Of the designs; where an answer of SCS is refused, Clarabel is asked.

    Examples
    --------
    Without velocities the printed inequality costs much, with them next to nothing:

    >>> from inswsn_lib.navigation import LMIDesigns
    >>> found = LMIDesigns().findings()
    >>> [round(found[f"cost.{seen}.percent"].value, 1) for seen in ("position", "full")]
    [50.0, 0.0]
    """

    period: float = 0.2
    process_noise: float = 1.0
    measurement_noise: float = 1.0
    margin: float = 0.01
    solver: Solver = "clarabel"

    def findings(self) -> dict[str, Finding]:
        r"""Return what the slip costs, and what the H-infinity filter gains and pays, in %.

        Returns
        -------
        dict of str to Finding
            ``cost.position.percent`` and ``cost.full.percent``, by how much the least
            :math:`\gamma` of (2.15) is too large, with positions alone measured and with both;
            ``curve.gain-saved`` and ``curve.rms-paid``, of the Kalman filter's worst-case gain and
            RMS error.

        Raises
        ------
        InfeasibleDesignError
            If an inequality has no solution.
        """
        process, measurement = ((s, s) for s in (self.process_noise, self.measurement_noise))
        full = ErrorModel.p1(self.period, process_noise=process, measurement_noise=measurement)
        positions = replace(full, C=full.C[:2], D=full.D[:2, :2])
        design = design_filter(full, margin=self.margin, solver=self._solvers)
        hinf, kalman = (gain_and_error(full, g) for g in (design.gain, predictor_gain(full)))
        saved, paid = 100 * (1 - hinf[0] / kalman[0]), 100 * (hinf[1] / kalman[1] - 1)
        over = "By how much the least gamma of P1's inequality is too large, {} measured."
        found = {
            "cost.position.percent": (self._excess(positions), over.format("positions alone")),
            "cost.full.percent": (self._excess(full), over.format("positions and velocities")),
            "curve.gain-saved": (saved, "By how much HF lowers the worst-case gain of KF."),
            "curve.rms-paid": (paid, "By how much HF raises the RMS error of KF."),
        }
        return {name: Finding(v, v, v, "%", how) for name, (v, how) in found.items()}

    @property
    def _solvers(self) -> tuple[Solver, ...]:
        return (self.solver, "clarabel")

    def _excess(self, model: ErrorModel) -> float:
        exact, printed = (
            design_filter(model, form, solver=self._solvers).gamma for form in get_args(Form)
        )
        return 100 * (printed / exact - 1)


def gain_and_error(model: ErrorModel, gain: Array) -> tuple[float, float]:
    """Return the worst-case gain of a predictor and its RMS error under white noise.

    Parameters
    ----------
    model : ErrorModel
    gain : ndarray, (n, m)
        B_f.

    Examples
    --------
    The deadbeat predictor of a random walk has the root of two for both:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> [round(cost, 4) for cost in iw.navigation.gain_and_error(model, [[1.0]])]
    [1.4142, 1.4142]
    """
    return hinf_norm(*model.error_system(gain)), steady_error(model, gain)
