"""Back-propagation networks, many seeds or data sets at once, trained as in 2011."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NamedTuple, Self, get_args

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array, number, one_of, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.kernels import choose
from inswsn_lib.learning.base import Regressor, Scale, Scaling

Trainer = Literal["levenberg-marquardt", "gradient-descent"]
#: The next weights and state of networks, and which of them are done
_Stepped = tuple[torch.Tensor, torch.Tensor, torch.Tensor]

_FLAT = 1e-7  # largest entry of a gradient at which a network is done
# Of Levenberg and Marquardt's method: first damping, its factor after a failed and after a good
# step, and the damping at which a network is done, as in MATLAB's trainlm; the least damping, so
# that one that has fallen can rise again.
_RULES = (1e-3, 10.0, 0.1, 1e10, 1e-20, _FLAT)


@dataclass(eq=False, repr=False)
class BackpropRegressor(Regressor):
    r"""Multilayer perceptron with one hidden layer, :math:`W_2 \tanh(W_1 x + b_1) + b_2`.

    The training minimises the mean squared error plus :math:`\lambda |\theta|^2` over all weights
    and biases :math:`\theta`, in double precision. Several networks that differ in their random
    numbers alone are trained at once; their predictions are averaged.

    Parameters
    ----------
    hidden : int
        Neurons of the hidden layer.
    trainer : {"levenberg-marquardt", "gradient-descent"}
        Damped Gauss-Newton steps, the standard of 2011's toolboxes, or plain gradient descent with
        momentum.
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
        :math:`\theta` of each network, :math:`W_1, b_1, W_2, b_2`, in scaled units.
    losses_ : ndarray, (networks,)
        Mean squared error on the training samples, in scaled units.
    steps_ : ndarray, (networks,)
        Steps until each was done.

    Examples
    --------
    Four neurons learn a parabola from 21 points; the two networks differ only in where they began:

    >>> import inswsn_lib as iw, numpy as np
    >>> X = np.linspace(-1, 1, 21)[:, None]
    >>> network = iw.BackpropRegressor(hidden=4, networks=2).fit(X, X[:, 0] ** 2)
    >>> network.predict([[0.5], [0.9]]).round(2).tolist()
    [0.25, 0.81]
    >>> network.predict_each([[0.5]]).shape, network.weights_.shape  # 4 + 4 + 4 + 1 parameters
    ((2, 1), (2, 13))
    """

    hidden: int = 10
    trainer: Trainer = "levenberg-marquardt"
    epochs: int = 300
    learning_rate: float = 0.01
    momentum: float = 0.0
    weight_decay: float = 0.0
    validation_share: float = 0.0
    patience: int = 6
    scaling: Scaling = "range"
    networks: int = 1
    random_state: int = 0

    def fit_many(
        self, Xs: Sequence[ArrayLike], ys: Sequence[ArrayLike], numbers: Sequence[int] | None = None
    ) -> list[Self]:
        """Train a copy of this estimator on each of several data sets of one shape, all at once.

        Parameters
        ----------
        Xs, ys : sequence of array_like, each as in `fit`
        numbers : sequence of int, optional
            What is added to the random state of each copy. Default: 0, 1, 2 ...

        Returns
        -------
        list of BackpropRegressor
            Fitted; each is what `fit` makes of its data set alone.

        Raises
        ------
        ParameterError
            If there are not as many of each, or the data sets are not of one shape.
        """
        self._check_parameters()
        numbers = range(len(Xs)) if numbers is None else numbers
        if not len(Xs) == len(ys) == len(numbers):
            told = Described(f"{len(Xs)}, {len(ys)} and {len(numbers)}")
            raise ParameterError("Xs, ys and numbers", told, "of the same length")
        copies = [replace(self, random_state=self.random_state + i) for i in numbers]
        samples = [copy._samples(X, y) for copy, X, y in zip(copies, Xs, ys, strict=True)]
        shapes = {(X.shape, Y.shape) for X, Y in samples}
        if len(shapes) > 1:
            raise ParameterError("the shapes of Xs and ys", sorted(shapes), "the same for all")
        if copies:
            _train(copies, samples)
        return copies

    def predict_each(self, X: ArrayLike) -> Array:
        """Return the prediction of every network, (networks, n) or (networks, n, outputs)."""
        return self._shaped(self._outputs(self._inputs(X)))

    def _fit(self, X: Array, Y: Array) -> None:
        self._check_parameters()
        _train([self], [(X, Y)])

    def _predict(self, X: Array) -> Array:
        return np.asarray(self._outputs(X).mean(axis=0))

    def _outputs(self, X: Array) -> Array:
        """Return the outputs of every network, (networks, n, outputs)."""
        out = self._layers.forward(self.weights_, self._X_scale.transform(X), np.tanh)
        return self._Y_scale.inverse_transform(out)

    def _prepare(self, X: Array, Y: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Scale a data set, and draw what is random, of each network.

        Returns inputs (networks, n, inputs), targets (networks, n, outputs), first weights
        (networks, parameters), and which samples train (networks, n).
        """
        self._X_scale, self._Y_scale = Scale.of(X, self.scaling), Scale.of(Y, self.scaling)
        self._layers = _Layers(X.shape[1], self.hidden, Y.shape[1])
        X, Y = self._X_scale.transform(X), self._Y_scale.transform(Y)
        streams = [np.random.default_rng([self.random_state, i]) for i in range(self.networks)]
        start = np.array([self._layers.first_weights(rng, X) for rng in streams])
        held = min(round(self.validation_share * len(X)), len(X) - 1)
        trains = np.ones((self.networks, len(X)), dtype=bool)
        for own, rng in zip(trains, streams, strict=True):
            own[rng.permutation(len(X))[:held]] = False
        Xs, Ys = (np.repeat(values[None], self.networks, axis=0) for values in (X, Y))
        return Xs, Ys, start, trains

    def _check_parameters(self) -> None:
        for name in ("hidden", "epochs", "patience", "networks"):
            whole(name, getattr(self, name), 1)
        whole("random_state", self.random_state)
        number("learning_rate", self.learning_rate, above=0)
        number("weight_decay", self.weight_decay, least=0)
        number("momentum", self.momentum, least=0, below=1)
        number("validation_share", self.validation_share, least=0, below=1)
        one_of("trainer", self.trainer, get_args(Trainer))
        one_of("scaling", self.scaling, ("range", "standard", "none"))


class _Layers(NamedTuple):
    """The sizes of the layers, and the network as a function of one flat vector of weights."""

    inputs: int
    hidden: int
    outputs: int

    def first_weights(self, rng: np.random.Generator, X: Array) -> Array:
        """Draw weights as Nguyen and Widrow (1990): the tanh bends are spread over the data."""
        h, d = self.hidden, self.inputs
        low, high = X.min(axis=0), X.max(axis=0)
        half = np.where(high > low, (high - low) / 2, 1.0)
        size = 0.7 * h ** (1 / d)
        directions = rng.standard_normal((h, d))
        directions *= size / np.linalg.norm(directions, axis=1, keepdims=True)
        spread = np.linspace(-1, 1, h) if h > 1 else np.zeros(1)
        W1 = directions / half
        b1 = size * spread * np.sign(directions[:, 0]) - W1 @ ((low + high) / 2)
        return np.concatenate([W1.ravel(), b1, rng.uniform(-1, 1, self.outputs * (h + 1))])

    def parts(self, weights: Any) -> tuple[Any, Any, Any, Any]:
        """Return W1, b1, W2 and b2 of each network."""
        d, h, o = self
        a, b, c = h * d, h * (d + 1), h * (d + 1 + o)
        W1, W2 = weights[:, :a].reshape(-1, h, d), weights[:, b:c].reshape(-1, o, h)
        return W1, weights[:, a:b], W2, weights[:, c:]

    def forward(self, weights: Any, X: Any, tanh: Callable[[Any], Any] = torch.tanh) -> Any:
        """Return the outputs, (networks, samples, outputs), for weights (networks, parameters).

        All are tensors, or with numpy's tanh arrays.
        """
        W1, b1, W2, b2 = self.parts(weights)
        return tanh(X @ W1.mT + b1[:, None]) @ W2.mT + b2[:, None]


@dataclass(frozen=True, eq=False)
class _Work:
    """What all trainers need: data, who trains on what, and the loss."""

    layers: _Layers
    X: torch.Tensor  # (networks, samples, inputs)
    Y: torch.Tensor  # (networks, samples, outputs)
    trains: torch.Tensor  # (networks, samples), bool
    decay: float

    @classmethod
    def on(
        cls, X: Array, Y: Array, trains: NDArray[np.bool_], weights: Array, decay: float
    ) -> _Work:
        """Return the work on arrays; the neurons are counted from the weights."""
        inputs, outputs = X.shape[2], Y.shape[2]
        hidden = (weights.shape[1] - outputs) // (inputs + 1 + outputs)
        layers, tensor = _Layers(inputs, hidden, outputs), torch.from_numpy
        return cls(layers, tensor(X), tensor(Y), tensor(trains), decay)

    def of(self, which: torch.Tensor) -> _Work:
        """Return the work of some of the networks."""
        return replace(self, X=self.X[which], Y=self.Y[which], trains=self.trains[which])

    def squares(self, weights: torch.Tensor) -> torch.Tensor:
        """Return the squared errors, mean over the outputs, (networks, samples)."""
        misses: torch.Tensor = self.layers.forward(weights, self.X) - self.Y
        return misses.square().mean(dim=-1)

    @property
    def validated(self) -> bool:
        """Whether samples are held back."""
        return not bool(self.trains.all())

    def watched(self, weights: torch.Tensor, squares: torch.Tensor) -> torch.Tensor:
        """Return what tells the best weights: the error on the samples held back, or the loss."""
        if self.validated:
            return _mean(squares, ~self.trains).detach()
        return self.losses(weights, squares).detach()

    def losses(self, weights: torch.Tensor, squares: torch.Tensor) -> torch.Tensor:
        """Return what each network minimises."""
        return _mean(squares, self.trains) + self.decay * weights.square().sum(dim=-1)

    def gradients(self, weights: torch.Tensor, squares: torch.Tensor) -> torch.Tensor:
        """Return the gradient of each network's loss in weights that it has been traced from."""
        # networks do not share weights, so the gradient of the sum is that of each
        (gradient,) = torch.autograd.grad(self.losses(weights, squares).sum(), weights)
        return gradient


def _mean(squares: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Return the mean over the samples of a mask, (networks,)."""
    return (squares * mask).sum(dim=-1) / mask.sum(dim=-1)


def _train(copies: Sequence[BackpropRegressor], samples: Sequence[tuple[Array, Array]]) -> None:
    """Train estimators that differ in their random state alone, each on its own samples."""
    first = copies[0]
    drawn = [copy._prepare(X, Y) for copy, (X, Y) in zip(copies, samples, strict=True)]
    X, Y, start, trains = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
    decay, epochs, patience = float(first.weight_decay), int(first.epochs), int(first.patience)
    work, weights = _Work.on(X, Y, trains, start, decay), torch.from_numpy(start)
    with _one_thread():
        if first.trainer == "gradient-descent":
            descend = partial(_descend, first.learning_rate, first.momentum)
            moving, still = weights.clone().requires_grad_(), torch.zeros_like(weights)
            weights, steps = _repeat(descend, work, moving, still, epochs, patience)
        else:
            train = choose("levenberg_marquardt")
            found = train(X, Y, trains, start, decay, epochs, patience, _RULES)
            weights, steps = map(torch.from_numpy, found)
        losses = _mean(work.squares(weights), work.trains)
    for i, copy in enumerate(copies):
        own = slice(i * first.networks, (i + 1) * first.networks)
        copy.weights_, copy.losses_ = weights[own].numpy(), losses[own].numpy()
        copy.steps_ = steps[own].numpy()


def _repeat(
    step: Callable[..., _Stepped],
    work: _Work,
    weights: torch.Tensor,
    state: torch.Tensor,
    epochs: int,
    patience: int,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Step all networks until each is done; return the best weights and the steps of each."""
    squares = work.squares(weights)  # once a step, for what is watched and for the next step
    best, least = weights.detach().clone(), work.watched(weights, squares)
    steps, failures = torch.zeros(len(weights), dtype=torch.int64), torch.zeros(len(weights))
    going = torch.arange(len(weights))  # which networks are not done
    for _ in range(epochs):
        weights, state, done = step(work, weights, squares, state)
        steps[going] += 1
        squares = work.squares(weights)
        now = work.watched(weights, squares)
        sound = torch.isfinite(weights).all(dim=-1)
        progress = sound & (now < least)
        best[going[progress]] = weights[progress].detach()
        least = torch.where(progress, now, least)
        failures = torch.where(progress, 0, failures + 1)
        left = sound & ~done
        if work.validated:
            left &= failures < patience
        if not left.any():
            break
        if not left.all():
            work, going = work.of(left), going[left]
            weights, state, least, failures = (x[left] for x in (weights, state, least, failures))
            squares = work.squares(weights)
    return best, steps


def _descend(
    rate: float,
    momentum: float,
    work: _Work,
    weights: torch.Tensor,
    squares: torch.Tensor,
    speed: torch.Tensor,
) -> _Stepped:
    """Step against the gradient, with momentum."""
    gradient = work.gradients(weights, squares)
    speed = momentum * speed - rate * gradient
    moved = (weights.detach() + speed).requires_grad_()
    return moved, speed, gradient.abs().amax(dim=-1) < _FLAT


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch use one thread, so that sums are formed in one order on every machine."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
