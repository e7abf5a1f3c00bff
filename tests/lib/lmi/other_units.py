"""Models for the tests of designs and the trial of systems, in other units and with few outputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from inswsn_lib import ErrorModel


def in_units(model: ErrorModel, rng: np.random.Generator, decades: float) -> ErrorModel:
    """Return the model in other units of states and outputs, up to so many decades apart."""
    sizes = len(model.A), len(model.C)
    S, W = (10.0 ** (decades * rng.uniform(-0.5, 0.5, size=size)) for size in sizes)
    return replace(
        model, A=model.A * S[:, None] / S, B=model.B * S[:, None], C=model.C * W[:, None] / S,
        D=model.D * W[:, None], L=model.L / S, E=model.E * S[:, None] / S,
    )  # fmt: skip


def positions_only(period: float) -> ErrorModel:
    """Return P1's model of which positions alone are measured."""
    return replace(ErrorModel.p1(period), C=np.eye(2, 4), D=np.eye(2))
