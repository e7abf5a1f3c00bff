"""What P2's inequality (9) certifies in three readings, and what is true of its weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
import pandas as pd
from scipy.linalg import solve_discrete_lyapunov

from inswsn_lib import lmi
from inswsn_lib.checks import Array
from inswsn_lib.lmi import FilterDesign, FusionDesign
from inswsn_lib.lmi.designs import FusionSolver, Noise

_SLACK = 1.001  # of the tied weights above their least level


@dataclass(frozen=True, eq=False)
class TheoremReading:
    """The inequality (9) for some local designs.

    Attributes
    ----------
    designs : sequence of FilterDesign
        The local filters, each with its own solution P of (10).
    solvers : tuple of str
        Of the weights.
    """

    designs: Sequence[FilterDesign]
    solvers: tuple[FusionSolver, ...] = ("structured", "clarabel")

    @cached_property
    def own(self) -> FusionDesign:
        """The weights of (9) with free, block-diagonal P, a process noise for each cluster."""
        return lmi.design_fusion(self.designs, "independent", "block", solver=self.solvers)

    @cached_property
    def common(self) -> FusionDesign:
        """The weights for the true input, with one INS."""
        return lmi.design_fusion(self.designs, "common", solver=self.solvers)

    @property
    def best(self) -> float:
        """The least gamma of the best cluster."""
        return min(design.gamma for design in self.designs)

    @property
    def worst(self) -> float:
        """The least gamma of the worst cluster."""
        return max(design.gamma for design in self.designs)

    @cached_property
    def true(self) -> float:
        """The gain of the weights of (9) with one INS."""
        return lmi.fusion_gain(self.designs, self.own.weights, "common")

    @cached_property
    def tied(self) -> float:
        """The least level at which there are weights for the local solutions."""
        tops = [d.error_system[1].T @ d.P @ d.error_system[1] for d in self.designs]
        low = float(max(np.linalg.norm(top, 2) for top in tops) ** 0.5)
        high = 2 * max(design.level for design in self.designs)
        while high > low * (1 + 1e-9):
            level = (low + high) / 2
            S = self.spared(level)
            slack = np.linalg.eigvalsh([*S, S.sum(axis=0) - np.eye(S.shape[1])])
            low, high = (low, level) if slack.min() >= 0 else (level, high)
        return high

    def spared(self, level: float) -> Array:
        """Return what each cluster can spare at a level with its local P: S_c, (N, n, n)."""
        spared = []
        for design in self.designs:
            P, (A, B, _) = design.P, design.error_system
            cross, spare = A.T @ P @ B, level**2 * np.eye(B.shape[1]) - B.T @ P @ B
            spared.append(P - A.T @ P @ A - cross @ np.linalg.solve(spare, cross.T))
        return np.stack(spared)

    def over_bounds(self) -> dict[str, float]:
        """Return gains over what (9) certifies for the weights, by the names of the record."""
        A, B, L = lmi.fusion_system(self.designs, self.own.weights, "common")
        # the energy of the one INS counts once for every cluster
        counted = np.hstack([B[:, :4] / len(self.designs) ** 0.5, B[:, 4:]])
        S = self.spared(_SLACK * self.tied)
        tied_weights = np.linalg.solve(S.sum(axis=0), S)
        full = lmi.design_fusion(self.designs, "independent", "full", solver=self.solvers)
        return {
            "tied-own": self._long_gain(tied_weights) / (_SLACK * self.tied),
            "own-over-bound": self._long_gain(self.own.weights) / self.own.level,
            "index-over-bound": lmi.hinf_norm(A, counted, L) / self.own.level,
            "true-over-bound": self.true / self.own.level,
            "block-over-full": self.own.gamma / full.gamma,
        }

    def _long_gain(self, weights: Array) -> float:
        """Return the gain with own noise over 300 steps, by a recursion, not by frequencies."""
        A, B, L = lmi.fusion_system(self.designs, weights, "independent")
        return lmi.finite_horizon_gain(A, np.zeros_like(A), B, L, 300, 1e-6)

    def worst_gain(self, noise: Noise, steps: int = 60) -> float:
        """Return root of output energy over input energy of (9)'s weights, at the worst input."""
        A, B, L = lmi.fusion_system(self.designs, self.own.weights, noise)
        worst = lmi.worst_disturbance(A, np.zeros_like(A), B, L, steps)
        x, energy = np.zeros(len(A)), np.zeros(2)
        for k in range(steps):
            s = worst.first if k == 0 else worst.feedback[k - 1] @ x
            x = A @ x + B @ s
            energy += s @ s, (L @ x) @ (L @ x)
        return float(np.sqrt(energy[1] / energy[0]))

    def correlations(self) -> Array:
        """Return those of the errors of two local filters, by pair and component, one INS."""
        A, B, _ = lmi.fusion_system(self.designs, self.own.weights, "common")
        joint = solve_discrete_lyapunov(A, B @ B.T)
        scale = np.sqrt(np.diag(joint))
        correlation = (joint / np.outer(scale, scale)).reshape(len(self.designs), 4, -1, 4)
        pairs = combinations(range(len(self.designs)), 2)
        return np.stack([np.diag(correlation[a, :, b]) for a, b in pairs])


def tabulate_readings(readings: Mapping[str, TheoremReading]) -> pd.DataFrame:
    """Return what (9) certifies and what is true, a column for each case."""
    rows = {
        name: {
            "least $\\gamma_c$, the best cluster": r.best,
            "least $\\gamma_c$, the worst cluster": r.worst,
            "(9) with the $P_c$ of (10): least $\\tilde\\gamma$": r.tied,
            "(9) with free $\\tilde P$, own noise: least $\\tilde\\gamma$": r.own.gamma,
            "true gain of those weights, one INS": r.true,
            "free $\\tilde P$, one INS: least $\\tilde\\gamma$": r.common.gamma,
        }
        for name, r in readings.items()
    }
    return pd.DataFrame(rows).map("{:.4f}".format).rename_axis("")


def largest_correlation(fixes: Array) -> float:
    """Return the largest correlation of a component between the fixes of two clusters.

    Of the errors of fixes, (clusters, steps, 2, runs), where all clusters have one.
    """
    together = fixes[:, ~np.isnan(fixes).any(axis=(0, 2, 3))]
    if not together.size:
        return 0.0
    of = np.stack([np.corrcoef(together[:, :, i].reshape(len(fixes), -1)) for i in (0, 1)])
    return float(np.abs(of - np.eye(len(fixes))).max())
