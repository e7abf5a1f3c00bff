"""What a design of an H-infinity filter gives, and what vouches for it; numpy alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from inswsn_lib.checks import Array
from inswsn_lib.models import ErrorModel

Form = Literal["exact", "printed"]


@dataclass(frozen=True)
class Certificate:
    """What vouches for a design, computed without the solver.

    Attributes
    ----------
    largest_eigenvalue : float
        Of the left side of the inequality at the solution, over the largest entry of that matrix;
        negative up to rounding.
    smallest_eigenvalue_p : float
        Over the largest; positive.
    norm : float
        H-infinity norm of the error system without jitter, from its frequency response.
    stochastic : bool
        Whether a gain below the design level is confirmed with the jitter as (2.11) has it: by the
        Riccati iteration, or by the norm if there is no jitter.

    Examples
    --------
    >>> from inswsn_lib.lmi import design_filter
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> design = design_filter(model)
    >>> certificate = design.certificate
    >>> certificate.norm <= design.level * (1 + 1e-6), certificate.stochastic
    (True, True)
    """

    largest_eigenvalue: float
    smallest_eigenvalue_p: float
    norm: float
    stochastic: bool


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
    A_f : ndarray, (n, n)
        A - B_f C.
    P : ndarray, (n, n)
        The solution of the inequality at `level`.
    certificate : Certificate
        See there.
    buildable : bool
        Whether the filter can be built so that (2.11) describes its error: only without jitter,
        since A_f would have to contain E times a number that nobody knows.
    status : str
        What the solver said.
    solver : str
        Its name: "Clarabel" or "SCS".

    Examples
    --------
    >>> from inswsn_lib.lmi import design_filter
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> design = design_filter(model, margin=0.05)
    >>> print(f"{design.gamma:.3f} {design.level:.3f} {design.gain.item():.2f} {design.buildable}")
    1.414 1.485 0.94 True
    """

    model: ErrorModel
    form: Form
    gamma: float
    level: float
    gain: Array
    A_f: Array
    P: Array
    certificate: Certificate
    buildable: bool
    status: str
    solver: str = "Clarabel"
