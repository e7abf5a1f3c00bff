"""Designs: the gain or the weights, the bound, and the certificate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.models import ErrorModel

Form = Literal["exact", "printed"]
Noise = Literal["common", "independent"]
Structure = Literal["full", "block"]
Solver = Literal["clarabel", "scs"]
FusionSolver = Literal["structured", "clarabel", "scs"]

#: The bounds on the least gamma may differ by this share
LARGEST_GAP = 1e-3


def told_gap(lower: float, upper: float) -> str:
    """Return what is said of bounds that are far apart."""
    return f"the least gamma is only known to lie between {lower:.6g} and {upper:.6g}"


class InfeasibleDesignError(InswsnError):
    """No filter satisfies the inequality, or none could be certified; the message says which.

    Examples
    --------
    A state that grows and is not seen has no filter:

    >>> import inswsn_lib as iw
    >>> try:
    ...     iw.design_filter(iw.ErrorModel(A=[[2]], B=[[1]], C=[[0]], D=[[1]], period=1.0))
    ... except iw.InfeasibleDesignError as error:
    ...     print(error)
    No solution of the inequality was found: the solver says infeasible.
    """


@dataclass(frozen=True)
class Certificate:
    """Evidence for a filter, computed without the solver.

    Norm and bounds are gains, in the unit of L x for noise of one unit. The eigenvalues are those
    in the units of the design, in which a Kalman predictor's error has the covariance I.

    Attributes
    ----------
    largest_eigenvalue : float
        Of the left side of the inequality, over its largest entry; negative up to rounding.
    smallest_eigenvalue_p : float
        Over the largest; positive.
    norm : float
        H-infinity norm of the error system without jitter, from its frequency response.
    lower : float
        No filter of the form has a bound below it: the value of a dual solution of the inequality,
        made exact, or what one step of the process noise does.
    upper : float
        A filter of the form is known to have it: that of the least gamma, not the one returned.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> print(f"{iw.design_filter(model, margin=1e-6).certificate.norm:.4f}")  # the root of 2
    1.4142
    """

    largest_eigenvalue: float
    smallest_eigenvalue_p: float
    norm: float
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class FilterDesign:
    r"""An H-infinity filter :math:`\hat x_{k+1} = A_f \hat x_k + B_f y_k` (P1 2.9).

    Attributes
    ----------
    model : ErrorModel
        The model it was designed for.
    form : {"exact", "printed"}
        The inequality.
    gamma : float
        The smallest bound that the inequality allows.
    level : float
        The bound that the gain was designed for, slightly above `gamma`; certified.
    gain : ndarray, (n, m)
        B_f.
    P : ndarray, (n, n)
        The solution of the inequality at `level`.
    certificate : Certificate
        Of a gain that has passed it.
    status : str
        What the solver said: "optimal", or "optimal_inaccurate".
    solver : {"clarabel", "scs"}
        Who said it.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> design = iw.design_filter(model, margin=0.05)
    >>> print(f"{design.gamma:.3f} {design.level:.3f} {design.gain.item():.2f} {design.buildable}")
    1.414 1.485 0.94 True
    """

    model: ErrorModel
    form: Form
    gamma: float
    level: float
    gain: Array
    P: Array
    certificate: Certificate
    status: str
    solver: Solver

    @property
    def A_f(self) -> Array:  # noqa: N802  # as in the papers
        """A - B_f C, (n, n)."""
        return self.model.A - self.gain @ self.model.C

    @property
    def error_system(self) -> tuple[Array, Array, Array]:
        """The matrices A_f, [B, -B_f D] and L of the estimation error without jitter (2.11)."""
        return self.model.error_system(self.gain)

    @property
    def buildable(self) -> bool:
        """Whether (2.11) is the error of a filter that can be built, which is so without jitter.

        With jitter, A_f would have to contain E times a number that nobody knows.
        """
        return not self.model.E.any()


@dataclass(frozen=True)
class FusionCertificate:
    """Evidence for the weights of a fusion, computed without the solver.

    Attributes
    ----------
    largest_eigenvalue : float
        Of the left side of the inequality with all clusters in one matrix, over its largest entry;
        negative up to rounding.
    weights_sum_error : float
        The largest entry of the sum of the weights less the identity.
    norm : float
        H-infinity norm of the fused error, from its frequency response.
    lower, upper : float
        No weights and P of the structure have a level below `lower`, by a dual solution made exact;
        some have `upper`.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> fusion = iw.design_fusion([iw.design_filter(model, margin=1e-6)] * 2)
    >>> print(f"{fusion.certificate.norm:.4f}")  # the root of 3/2
    1.2247
    """

    largest_eigenvalue: float
    weights_sum_error: float
    norm: float
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class FusionDesign:
    """The weights of a fused estimate (P2 6).

    Attributes
    ----------
    designs : tuple of FilterDesign
        The N local filters.
    noise : {"common", "independent"}
        Whether the clusters share their process noise.
    structure : {"full", "block"}
        Of P.
    gamma, level : float
        As in `FilterDesign`, of the gain from the noise to the fused error seen through L.
    weights : ndarray, (N, n, n)
        M_c.
    P : ndarray, (N n, N n) or (N, n, n)
        The solution of the inequality at `level`; with the structure "block" its diagonal blocks.
    certificate : FusionCertificate
        Of weights that have passed it.
    status : str
        As in `FilterDesign`.
    solver : {"structured", "clarabel", "scs"}
        Who said it.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> fusion = iw.design_fusion([iw.design_filter(model)] * 2, structure="block")
    >>> fusion.weights.shape, fusion.P.shape, fusion.solver
    ((2, 1, 1), (2, 1, 1), 'structured')
    """

    designs: tuple[FilterDesign, ...]
    noise: Noise
    structure: Structure
    gamma: float
    level: float
    weights: Array
    P: Array
    certificate: FusionCertificate
    status: str
    solver: FusionSolver
