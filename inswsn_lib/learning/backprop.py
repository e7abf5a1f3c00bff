"""Back-propagation networks, many seeds or data sets at once, trained as in 2011 or today."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin, clone

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning.checking import data_to_fit, data_to_predict
from inswsn_lib.learning.kernels import check_positive
from inswsn_lib.learning.scaling import Scale, Scaling

Array = NDArray[np.float64]
Trainer = Literal["gradient-descent", "levenberg-marquardt", "l-bfgs"]

# Of Levenberg and Marquardt's method: first damping, its factor after a failed and after a good
# step, and the damping at which a network is done; as in MATLAB's trainlm.
_DAMPING, _WORSE, _BETTER, _DONE = 1e-3, 10.0, 0.1, 1e10
_LEAST = 1e-20  # so that a damping that has fallen can rise again
_FLAT = 1e-7  # largest entry of a gradient at which a network is done


class BackpropRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    r"""Multilayer perceptron with one hidden layer, :math:`W_2 \tanh(W_1 x + b_1) + b_2`.

    The training minimises the mean squared error plus :math:`\lambda |\theta|^2` over all weights
    and biases :math:`\theta`, in double precision. Several networks that differ in their random
    numbers alone are trained at once; their predictions are averaged.

    Parameters
    ----------
    hidden : int
        Neurons of the hidden layer.
    trainer : {"levenberg-marquardt", "gradient-descent", "l-bfgs"}
        Damped Gauss-Newton steps, the standard of 2011's toolboxes; plain gradient descent with
        momentum; or scipy's L-BFGS.
    epochs : int
        The most steps.
    learning_rate, momentum : float
        Of gradient descent.
    weight_decay : float
        :math:`\lambda`, 0 or more.
    validation_share : float
        Share of the samples, drawn at random for each network, that do not train but stop the
        training: the weights are those of the least error on them. 0 does without.
    patience : int
        Steps without progress on the validation samples after which the training stops.
    scaling : {"range", "standard", "none"}
        Inputs and targets mapped to [-1, 1], or to mean 0 and deviation 1, or left as they are.
    networks : int
        How many.
    random_state : int
        Seed of the first network's random numbers; each has its own stream.

    Attributes
    ----------
    weights_ : ndarray, (networks, parameters)
        :math:`\theta` of each network, in scaled units.
    losses_ : ndarray, (networks,)
        Mean squared error on the training samples, in scaled units.
    steps_ : ndarray, (networks,)
        Steps until each was done.

    Examples
    --------
    Four neurons learn a parabola from 21 points; the two networks differ only in where they began:

    >>> import numpy as np
    >>> from inswsn_lib.learning import BackpropRegressor
    >>> X = np.linspace(-1, 1, 21)[:, None]
    >>> network = BackpropRegressor(hidden=4, networks=2).fit(X, X[:, 0] ** 2)
    >>> network.predict([[0.5], [0.9]]).round(2).tolist()
    [0.25, 0.81]
    >>> network.predict_each([[0.5]]).shape, network.weights_.shape  # 4 + 4 + 4 + 1 parameters
    ((2, 1), (2, 13))
    """

    def __init__(
        self,
        hidden: int = 10,
        trainer: Trainer = "levenberg-marquardt",
        epochs: int = 300,
        learning_rate: float = 0.01,
        momentum: float = 0.0,
        weight_decay: float = 0.0,
        validation_share: float = 0.0,
        patience: int = 6,
        scaling: Scaling = "range",
        networks: int = 1,
        random_state: int = 0,
    ) -> None:
        self.hidden = hidden
        self.trainer = trainer
        self.epochs = epochs
        self.learning_rate = learning_rate
        self.momentum = momentum
        self.weight_decay = weight_decay
        self.validation_share = validation_share
        self.patience = patience
        self.scaling = scaling
        self.networks = networks
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Train on inputs (n, inputs) and targets (n,) or (n, outputs).

        Parameters
        ----------
        X : array_like, (n, inputs)
            Inputs.
        y : array_like, (n,) or (n, outputs)
            Targets.

        Returns
        -------
        BackpropRegressor
            Itself, fitted.

        Raises
        ------
        ParameterError
            If a parameter has a value it may not have.
        ValueError
            If the data are not such arrays, or not finite.
        """
        self._train_all([self._prepared(X, y)])
        return self

    def fit_many(
        self,
        Xs: Sequence[ArrayLike],
        ys: Sequence[ArrayLike],
        numbers: Sequence[int] | None = None,
    ) -> list[Self]:
        """Train a copy of this estimator on each of several data sets of one shape, all at once.

        Parameters
        ----------
        Xs : sequence of array_like, each (n, inputs)
        ys : sequence of array_like, each (n,) or (n, outputs)
        numbers : sequence of int, optional
            What is added to the random state of each copy, so that the networks differ. Default:
            0, 1, 2 ...

        Returns
        -------
        list of BackpropRegressor
            Fitted; each is what `fit` makes of its data set alone.

        Raises
        ------
        ParameterError
            If there are not as many inputs as targets and numbers, or the data sets are not of one
            shape.

        Examples
        --------
        One data set and its negative, with networks that begin alike:

        >>> import numpy as np
        >>> from inswsn_lib.learning import BackpropRegressor
        >>> X = np.linspace(-1, 1, 21)[:, None]
        >>> y = X[:, 0] ** 2
        >>> up, down = BackpropRegressor(hidden=4).fit_many([X, X], [y, -y], numbers=[0, 0])
        >>> [round(float(machine.predict([[0.9]])[0]), 2) for machine in (up, down)]
        [0.81, -0.81]
        """
        self._check_parameters()
        numbers = range(len(Xs)) if numbers is None else numbers
        if not len(Xs) == len(ys) == len(numbers):
            told = f"{len(Xs)}, {len(ys)} and {len(numbers)}"
            raise ParameterError("Xs, ys and numbers", told, "as many of each")
        copies = [clone(self).set_params(random_state=self.random_state + i) for i in numbers]
        jobs = [copy._prepared(X, y) for copy, X, y in zip(copies, Xs, ys, strict=True)]
        shapes = {(job.inputs.shape, job.targets.shape) for job in jobs}
        if len(shapes) > 1:
            raise ParameterError("Xs and ys", f"of shapes {sorted(shapes)}", "of one shape")
        if jobs:
            self._train_all(jobs)
        return copies

    def _prepared(self, X: ArrayLike, y: ArrayLike) -> _Job:
        """Check and scale a data set, and draw what is random."""
        self._check_parameters()
        inputs, given = data_to_fit(self, X, y)
        targets = given.reshape(len(given), -1)
        self._flat = given.ndim == 1
        self._inputs_scale = Scale.of(inputs, self.scaling)
        self._targets_scale = Scale.of(targets, self.scaling)
        self._shape = _Shape(inputs.shape[1], self.hidden, targets.shape[1])
        scaled = self._inputs_scale.there(inputs)
        streams = [np.random.default_rng([self.random_state, i]) for i in range(self.networks)]
        start = np.array([self._shape.initial(rng, scaled) for rng in streams])
        trains = np.array([self._training_mask(rng, len(scaled)) for rng in streams])
        return _Job(self, scaled, self._targets_scale.there(targets), start, trains)

    def _train_all(self, jobs: list[_Job]) -> None:
        def stacked(arrays: list[Array]) -> torch.Tensor:
            repeated = np.repeat(np.array(arrays), self.networks, axis=0)
            return torch.from_numpy(repeated)

        with _one_thread():
            work = _Work(
                jobs[0].estimator._shape,
                stacked([job.inputs for job in jobs]),
                stacked([job.targets for job in jobs]),
                torch.from_numpy(np.concatenate([job.trains for job in jobs])),
                self.weight_decay,
            )
            start = torch.from_numpy(np.concatenate([job.start for job in jobs]))
            weights, steps = self._train(work, start)
            losses = work.errors(weights, work.trains).numpy()
        for i, job in enumerate(jobs):
            own = slice(i * self.networks, (i + 1) * self.networks)
            job.estimator._keep(weights.numpy()[own], losses[own], steps[own])

    def _keep(self, weights: Array, losses: Array, steps: NDArray[np.int64]) -> None:
        self.weights_: Array = weights
        self.losses_: Array = losses
        self.steps_: NDArray[np.int64] = steps

    def predict_each(self, X: ArrayLike) -> Array:
        """Return the prediction of every network, (networks, n) or (networks, n, outputs).

        Parameters
        ----------
        X : array_like, (n, inputs)
            Inputs.

        Returns
        -------
        ndarray, (networks, n) or (networks, n, outputs)
        """
        inputs = data_to_predict(self, X)
        with _one_thread():
            scaled = torch.from_numpy(self._inputs_scale.there(inputs))
            out = self._shape.forward(torch.from_numpy(self.weights_), scaled).numpy()
        out = self._targets_scale.back(out)
        return out[:, :, 0] if self._flat else out

    def predict(self, X: ArrayLike) -> Array:
        """Return the mean prediction of the networks, (n,) or (n, outputs).

        Parameters
        ----------
        X : array_like, (n, inputs)
            Inputs.

        Returns
        -------
        ndarray, (n,) or (n, outputs)
        """
        return np.asarray(self.predict_each(X).mean(axis=0))

    def _train(self, work: _Work, start: torch.Tensor) -> tuple[torch.Tensor, NDArray[np.int64]]:
        if self.trainer == "l-bfgs":
            return _l_bfgs(work, start, self.epochs)
        stepper: Any = (
            _LevenbergMarquardt(work, start)
            if self.trainer == "levenberg-marquardt"
            else _GradientDescent(work, start, self.learning_rate, self.momentum)
        )
        return _steps(work, stepper, start, self.epochs, self.patience)

    def _training_mask(self, rng: np.random.Generator, samples: int) -> NDArray[np.bool_]:
        held = min(round(self.validation_share * samples), samples - 1)
        mask = np.ones(samples, dtype=bool)
        mask[rng.permutation(samples)[:held]] = False
        return mask

    def _check_parameters(self) -> None:
        for name, least in (
            ("hidden", 1), ("epochs", 1), ("patience", 1), ("networks", 1), ("random_state", 0),
        ):  # fmt: skip
            value = getattr(self, name)
            whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
            if not whole or value < least:
                raise ParameterError(name, value, f"a whole number, {least} or more")
        check_positive("learning_rate", self.learning_rate)
        for name, below in (("momentum", 1.0), ("validation_share", 1.0), ("weight_decay", np.inf)):
            value = getattr(self, name)
            number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not (number and 0 <= value < below):
                raise ParameterError(name, value, f"0 or more, below {below:g}")
        if self.trainer not in ("levenberg-marquardt", "gradient-descent", "l-bfgs"):
            raise ParameterError(
                "trainer", self.trainer,
                'one of "levenberg-marquardt", "gradient-descent", "l-bfgs"',
            )  # fmt: skip
        if self.trainer == "l-bfgs" and self.validation_share:
            raise ParameterError("validation_share", self.validation_share, 'with "l-bfgs", 0')
        if self.scaling not in ("none", "range", "standard"):
            raise ParameterError("scaling", self.scaling, 'one of "none", "range", "standard"')


@dataclass(frozen=True)
class _Shape:
    """The sizes of the layers, and the network as a function of one flat vector of parameters."""

    inputs: int
    hidden: int
    outputs: int

    def initial(self, rng: np.random.Generator, inputs: Array) -> Array:
        """Draw parameters as Nguyen and Widrow (1990): the tanh bends are spread over the data."""
        h, d = self.hidden, self.inputs
        low, high = inputs.min(axis=0), inputs.max(axis=0)
        half = np.where(high > low, (high - low) / 2, 1.0)
        size = 0.7 * h ** (1 / d)
        directions = rng.standard_normal((h, d))
        directions *= size / np.linalg.norm(directions, axis=1, keepdims=True)
        offsets = size * np.linspace(-1, 1, h) * np.sign(directions[:, 0]) if h > 1 else [0.0]
        W1 = directions / half
        b1 = np.asarray(offsets) - W1 @ ((low + high) / 2)
        last = rng.uniform(-1, 1, self.outputs * (h + 1))
        return np.concatenate([W1.ravel(), b1, last])

    def parts(self, weights: torch.Tensor) -> list[torch.Tensor]:
        h, d, o = self.hidden, self.inputs, self.outputs
        W1, b1, W2, b2 = torch.split(weights, [h * d, h, o * h, o], dim=-1)
        lead = weights.shape[:-1]
        return [W1.reshape(*lead, h, d), b1, W2.reshape(*lead, o, h), b2]

    def forward(self, weights: torch.Tensor, inputs: torch.Tensor) -> torch.Tensor:
        """Return the outputs, (networks, samples, outputs), for weights (networks, parameters)."""
        W1, b1, W2, b2 = self.parts(weights)
        bent = torch.tanh(inputs @ W1.mT + b1.unsqueeze(-2))
        return bent @ W2.mT + b2.unsqueeze(-2)


@dataclass(frozen=True, eq=False)
class _Job:
    """A data set in scaled units, and the random numbers of the networks that train on it."""

    estimator: BackpropRegressor
    inputs: Array  # (samples, inputs)
    targets: Array  # (samples, outputs)
    start: Array  # (networks, parameters)
    trains: NDArray[np.bool_]  # (networks, samples)


@dataclass(frozen=True, eq=False)
class _Work:
    """What all trainers need: data, who trains on what, and the loss."""

    shape: _Shape
    inputs: torch.Tensor  # (networks, samples, inputs)
    targets: torch.Tensor  # (networks, samples, outputs)
    trains: torch.Tensor  # (networks, samples), bool
    decay: float

    def errors(self, weights: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the mean squared error of each network over the samples of its mask."""
        squares = (self.shape.forward(weights, self.inputs) - self.targets).square().mean(dim=-1)
        return (squares * mask).sum(dim=-1) / mask.sum(dim=-1)

    def watched(self, weights: torch.Tensor, validated: bool) -> torch.Tensor:
        """Return what tells the best weights: the error on the samples held back, or the loss."""
        return self.errors(weights, ~self.trains) if validated else self.losses(weights)

    def of(self, which: torch.Tensor) -> _Work:
        """Return the work of some of the networks."""
        return replace(
            self, inputs=self.inputs[which], targets=self.targets[which], trains=self.trains[which]
        )

    def losses(self, weights: torch.Tensor) -> torch.Tensor:
        """Return what each network minimises."""
        return self.errors(weights, self.trains) + self.decay * weights.square().sum(dim=-1)

    def gradients(self, weights: torch.Tensor) -> torch.Tensor:
        moving = weights.detach().requires_grad_()
        # networks do not share parameters, so the gradient of the sum is that of each
        (gradient,) = torch.autograd.grad(self.losses(moving).sum(), moving)
        return gradient


class _GradientDescent:
    """Plain steps against the gradient, with momentum."""

    def __init__(self, work: _Work, start: torch.Tensor, rate: float, momentum: float) -> None:
        self._work, self._rate, self._momentum = work, rate, momentum
        self._speed = torch.zeros_like(start)

    def step(self, weights: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        gradient = self._work.gradients(weights)
        self._speed = self._momentum * self._speed - self._rate * gradient
        done = gradient.abs().amax(dim=-1) < _FLAT
        return weights + self._speed, done

    def keep(self, left: torch.Tensor) -> _Work:
        """Go on with some of the networks."""
        self._work, self._speed = self._work.of(left), self._speed[left]
        return self._work


class _LevenbergMarquardt:
    """Damped Gauss-Newton steps, each network with its own damping."""

    def __init__(self, work: _Work, start: torch.Tensor) -> None:
        self._work = work
        self._damping = torch.full((len(start),), _DAMPING, dtype=start.dtype)

    def step(self, weights: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        work = self._work
        normal, slope = _normal_equations(work, weights)
        unit = torch.eye(normal.shape[-1], dtype=normal.dtype)
        moved, before = weights.clone(), work.losses(weights)
        done = slope.abs().amax(dim=-1) < _FLAT
        left = torch.arange(len(weights))  # networks that look for a step that lowers their loss
        part = work
        while len(left):
            damped = normal + self._damping[left, None, None] * unit
            factor, _ = torch.linalg.cholesky_ex(damped)
            tried = weights - torch.cholesky_solve(slope.unsqueeze(-1), factor).squeeze(-1)
            better = part.losses(tried) < before  # not so for what is not a number
            moved[left[better]] = tried[better]
            factors = torch.where(better, _BETTER, _WORSE)
            self._damping[left] = (self._damping[left] * factors).clamp(min=_LEAST)
            again = ~better & (self._damping[left] <= _DONE)
            normal, slope, weights, before, left = (
                x[again] for x in (normal, slope, weights, before, left)
            )
            part = part.of(again)
        return moved, done | (self._damping > _DONE)

    def keep(self, left: torch.Tensor) -> _Work:
        """Go on with some of the networks."""
        self._work, self._damping = self._work.of(left), self._damping[left]
        return self._work


def _normal_equations(work: _Work, weights: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    r"""Return J'J and J'r of each network, the Jacobian J of its residuals r, never formed.

    With z = (x, 1), the bent layer h = (tanh(V z), 1) and its slopes d, the derivative of output o
    is :math:`W_{2,oj} d_j z_a` in :math:`V_{ja}` and :math:`\delta_{op} h_k` in :math:`(W_2,
    b_2)_{pk}`. So the blocks of J'J are those of F'F, F'H and H'H, with F = d z and H = h for each
    sample, times products of :math:`W_2`. Halves of the loss and its slope: the factor 2 is left
    out of both.
    """
    W1, b1, W2, b2 = work.shape.parts(weights)
    nets, samples = work.trains.shape
    ones = torch.ones((nets, samples, 1), dtype=weights.dtype)
    bent = torch.tanh(work.inputs @ W1.mT + b1.unsqueeze(-2))
    trains = work.trains.to(weights.dtype)  # before the division, which is else one of float32
    share = (trains / trains.sum(dim=-1, keepdim=True)).unsqueeze(-1)
    share = share / work.targets.shape[-1]
    residual = (bent @ W2.mT + b2.unsqueeze(-2) - work.targets) * share
    slopes, H = 1 - bent.square(), torch.cat([bent, ones], dim=-1)
    hidden, outputs = slopes.shape[-1], residual.shape[-1]
    # the order of a network's parameters: all of W1, then b1; all of W2, then b2
    F = torch.cat([(slopes.unsqueeze(-1) * work.inputs.unsqueeze(-2)).flatten(2), slopes], dim=-1)
    of = torch.cat(
        [torch.arange(hidden).repeat_interleave(work.shape.inputs), torch.arange(hidden)]
    )
    ahead = W2[:, :, of]  # the weight from the neuron of each first parameter to each output
    weighted = F * share
    first = (weighted.mT @ F) * (ahead.mT @ ahead)
    cross = (weighted.mT @ H).unsqueeze(-2) * ahead.mT.unsqueeze(-1)  # (nets, first, outputs, k)
    last = H.mT @ (H * share)
    order = _last_order(hidden, outputs)
    cross = cross.flatten(2)[:, :, order]
    block = torch.zeros((nets, outputs, hidden + 1, outputs, hidden + 1), dtype=weights.dtype)
    for o in range(outputs):
        block[:, o, :, o, :] = last
    square = block.reshape(nets, len(order), len(order))[:, order][:, :, order]
    normal = torch.cat(
        [torch.cat([first, cross], dim=-1), torch.cat([cross.mT, square], dim=-1)], dim=-2
    )
    slope = torch.cat(
        [
            (F * (residual @ ahead)).sum(dim=-2),
            (residual.mT @ H).flatten(1)[:, order],
        ],
        dim=-1,
    )
    unit = torch.eye(normal.shape[-1], dtype=normal.dtype)
    return normal + work.decay * unit, slope + work.decay * weights


def _last_order(hidden: int, outputs: int) -> torch.Tensor:
    """Return where the entries of (W2, b2), output by output, stand as W2 first and then b2."""
    places = torch.arange(outputs * (hidden + 1)).reshape(outputs, hidden + 1)
    return torch.cat([places[:, :hidden].flatten(), places[:, hidden]])


def _steps(
    work: _Work, stepper: Any, weights: torch.Tensor, epochs: int, patience: int
) -> tuple[torch.Tensor, NDArray[np.int64]]:
    """Step all networks until each is done; return the best weights and the steps of each."""
    best, steps = weights.clone(), torch.zeros(len(weights), dtype=torch.int64)
    going = torch.arange(len(weights))  # which networks are not done
    validated = not bool(work.trains.all())
    least = work.watched(weights, validated)
    failures = torch.zeros(len(weights), dtype=torch.int64)
    for _ in range(epochs):
        moved, done = stepper.step(weights)
        steps[going] += 1
        now = work.watched(moved, validated)
        sound = torch.isfinite(moved).all(dim=-1)
        progress = sound & (now < least)
        best[going[progress]] = moved[progress]
        least = torch.where(progress, now, least)
        failures = torch.where(progress, 0, failures + 1)
        left = sound & ~done
        if validated:
            left &= failures < patience
        weights = moved
        if not left.all():
            weights, least, failures, going = (x[left] for x in (weights, least, failures, going))
            work = stepper.keep(left)
        if not len(going):
            break
    return best, steps.numpy()


def _l_bfgs(
    work: _Work, start: torch.Tensor, epochs: int
) -> tuple[torch.Tensor, NDArray[np.int64]]:
    """Minimise each network's loss with scipy's L-BFGS."""
    found, steps = start.clone(), np.zeros(len(start), dtype=np.int64)
    for i, first in enumerate(start):
        alone = work.of(torch.tensor([i]))

        def loss(flat: Array, alone: _Work = alone) -> tuple[float, Array]:
            weights = torch.from_numpy(flat[None].copy())
            return float(alone.losses(weights)), alone.gradients(weights)[0].numpy()

        result = minimize(
            loss, first.numpy(), jac=True, method="L-BFGS-B",
            options={"maxiter": epochs, "maxfun": 4 * epochs, "ftol": 1e-15, "gtol": _FLAT},
        )  # fmt: skip
        found[i], steps[i] = torch.from_numpy(result.x), result.nit
    return found, steps


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch use one thread, so that sums are formed in one order on every machine."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
