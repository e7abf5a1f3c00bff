r"""Levenberg and Marquardt's training of small networks, one after the other.

The network is :math:`W_2 \tanh(W_1 x + b_1) + b_2`. With z = (x, 1), h = (tanh, 1), the slopes d of
the tanh and :math:`g_{ja} = d_j z_a`, J'J has a block :math:`H'H` for each output o, all alike:

.. math::
    J'J = \begin{bmatrix} (G'G)_{ja,kb} \sum_o w_{oj} w_{ok} & w_{oj} (G'H)_{ja} \\ . & H'H
    \end{bmatrix} ,

w being :math:`W_2`. So one small factor eliminates all outputs, and there is left, damping aside,
:math:`(G'G - G'H (H'H)^{-1} H'G)_{ja,kb} \sum_o w_{oj} w_{ok}`.

Weights lie in one vector, neuron by neuron (a row of W1, its b1), then output by output (a row of
W2, its b2). Samples are the last axis, those that train before the others. Inner loops run over
rows that were taken out before: with two indices numba does not vectorise them.
"""

import math

import numpy as np

from inswsn_lib.kernels.choice import kernel

# Sums may be formed in any order, so that several terms are added at a time
_SUMS = {"reassoc", "contract"}


@kernel()
def levenberg_marquardt(X, Y, trains, weights, decay, epochs, patience, rules):
    """Return the best weights, and the steps of each network; arguments as in `backprop`."""
    (networks, samples, inputs), outputs = X.shape, Y.shape[2]
    start, worse, better, most, lowest, flat = rules
    places = _places(inputs, (weights.shape[1] - outputs) // (inputs + 1 + outputs), outputs)
    best, steps, now = weights.copy(), np.empty(networks, np.int64), np.empty(len(places))
    for i in range(networks):
        Z, T, m = _sorted(X[i], Y[i], trains[i])
        for k in range(len(now)):
            now[k] = weights[i, places[k]]
        loss, least, H, R = _forward(now, Z, T, m, decay)
        steps[i], failures, damping, done = 0, 0, start, False
        while steps[i] < epochs and not done and (m == samples or failures < patience):
            wide, GG, HG, HH, slope = _normal(now, Z, H, R, m, decay)
            lower = False
            while not lower and damping <= most:
                sound, step = _solve(wide, GG, HG, HH, slope, decay + damping)
                if sound:
                    tried = now - step
                    new = _forward(tried, Z, T, m, decay)
                    lower = new[0] < loss  # not so for what is not a number
                damping = max(damping * (better if lower else worse), lowest)
            steps[i], failures = steps[i] + 1, failures + 1
            if lower:
                now, (loss, watched, H, R) = tried, new
                if watched < least:
                    least, failures = watched, 0
                    for k in range(len(now)):
                        best[i, places[k]] = now[k]
            done = _largest(slope) < flat or damping > most
    return best, steps


@kernel()
def _sorted(X, Y, trains):
    """Return inputs and targets, samples that train first, and how many do."""
    (samples, inputs), outputs = X.shape, Y.shape[1]
    Z, T = np.empty((inputs + 1, samples)), np.empty((outputs, samples))
    Z[inputs] = 1
    place, m = 0, 0
    for kind in (True, False):
        for s in range(samples):
            if trains[s] == kind:
                for a in range(inputs):
                    Z[a, place] = X[s, a]
                for o in range(outputs):
                    T[o, place] = Y[s, o]
                place += 1
        if kind:
            m = place
    return Z, T, m


@kernel()
def _places(inputs, hidden, outputs):
    """Return where the weights, in the order of this file, stand in the caller's."""
    places = np.empty(hidden * (inputs + 1) + outputs * (hidden + 1), np.int64)
    first, last = _parts(places, inputs, hidden, outputs)
    after = hidden * (inputs + 1)
    for j in range(hidden):
        for a in range(inputs):
            first[j, a] = j * inputs + a
        first[j, inputs] = hidden * inputs + j
        for o in range(outputs):
            last[o, j] = after + o * hidden + j
    for o in range(outputs):
        last[o, hidden] = after + outputs * hidden + o
    return places


@kernel()
def _parts(weights, inputs, hidden, outputs):
    """Return (W1, b1) and (W2, b2), parts of the weights."""
    q = hidden * (inputs + 1)
    return weights[:q].reshape(hidden, inputs + 1), weights[q:].reshape(outputs, hidden + 1)


@kernel(fastmath=_SUMS)
def _forward(weights, Z, T, m, decay):
    """Return the loss, the error that is watched, the bent layer H, and the residuals R.

    Watched is the error of the samples after the first m, or where there are none the loss.
    """
    (z, samples), outputs = Z.shape, len(T)
    hidden = (len(weights) - outputs) // (z + outputs)
    first, last = _parts(weights, z - 1, hidden, outputs)
    H, R = np.empty((hidden + 1, samples)), np.empty((outputs, samples))
    H[hidden] = 1
    for j in range(hidden):
        h = H[j]
        h[:] = 0
        for a in range(z):
            _add(h, first[j, a], Z[a])
        for s in range(samples):
            h[s] = math.tanh(h[s])
    trained, held = 0.0, 0.0
    for o in range(outputs):
        r = R[o]
        r[:] = 0
        _add(r, -1.0, T[o])
        for j in range(hidden + 1):
            _add(r, last[o, j], H[j])
        trained += _dot(r[:m], r[:m])
        held += _dot(r[m:], r[m:])
    loss = trained / (m * outputs) + decay * _dot(weights, weights)
    return loss, held / ((samples - m) * outputs) if m < samples else loss, H, R


@kernel()
def _normal(weights, Z, H, R, m, decay):
    """Return the weight ahead of each column of G, by output, G'G, H'G, H'H, and the slope.

    Of what is symmetric the upper triangle.
    """
    z, outputs, r, share = len(Z), len(R), len(H), 1 / (m * len(R))
    last = _parts(weights, z - 1, r - 1, outputs)[1]
    q = (r - 1) * z
    wide, G, back, slope = np.empty((outputs, q)), np.empty((q, m)), np.empty(m), weights.copy()
    GG, HG, HH = np.empty((q, q)), np.empty((r, q)), np.empty((r, r))
    for k in range(len(slope)):
        slope[k] *= decay
    for j in range(r - 1):
        back[:] = 0
        for o in range(outputs):
            for a in range(j * z, j * z + z):
                wide[o, a] = last[o, j]
            _add(back, last[o, j], R[o])
        h = H[j]
        for a in range(z):
            g, x = G[j * z + a], Z[a]
            for s in range(m):
                g[s] = (1 - h[s] * h[s]) * x[s]
            slope[j * z + a] += share * _dot(g, back)
    for a in range(q):
        for b in range(a, q):
            GG[a, b] = share * _dot(G[a], G[b])
    for k in range(r):
        h = H[k, :m]
        for a in range(q):
            HG[k, a] = share * _dot(h, G[a])
        for p in range(k, r):
            HH[k, p] = share * _dot(h, H[p])
        for o in range(outputs):
            slope[q + o * r + k] += share * _dot(h, R[o])
    return wide, GG, HG, HH, slope


@kernel()
def _solve(wide, GG, HG, HH, slope, damping):
    """Return whether the damped equations are definite, and if so the step."""
    (r, q), outputs = HG.shape, len(wide)
    z = q // (r - 1)
    S, half, small, step = GG.copy(), HG.copy(), HH.copy(), slope.copy()
    for k in range(r):
        small[k, k] += damping
    if not _factor(small):
        return False, step
    for k in range(r):  # half becomes U'^-1 H'G, U'U being the damped H'H
        for p in range(k):
            _add(half[k], -small[p, k], half[p])
        _divide(half[k], small[k, k])
    for a in range(q):
        row = S[a, a:]
        for k in range(r):
            _add(row, -half[k, a], half[k, a:])
        for b in range(a - a % z, q, z):  # neuron by neuron, whose weights ahead are alike
            both = 0.0
            for o in range(outputs):
                both += wide[o, a] * wide[o, b]
            for c in range(max(a, b), b + z):
                S[a, c] *= both
        S[a, a] += damping
    if not _factor(S):
        return False, step
    top = step[:q]
    for o in range(outputs):
        own = step[q + o * r : q + o * r + r]
        _down(small, own)
        for k in range(r):
            for a in range(q):
                top[a] -= own[k] * half[k, a] * wide[o, a]
    _down(S, top)
    _up(S, top)
    for o in range(outputs):
        own = step[q + o * r : q + o * r + r]
        for k in range(r):
            for a in range(q):
                own[k] -= half[k, a] * wide[o, a] * top[a]
        _up(small, own)
    return True, step


@kernel()
def _factor(A):
    """Overwrite the upper triangle of A by its factor U, A = U'U; return whether there is one."""
    for k in range(len(A)):
        row = A[k, k:]
        for p in range(k):
            _add(row, -A[p, k], A[p, k:])
        if not row[0] > 0:
            return False
        _divide(row, math.sqrt(row[0]))
    return True


@kernel()
def _down(U, b):
    """Overwrite b by U'^-1 b."""
    for k in range(len(U)):
        b[k] /= U[k, k]
        _add(b[k + 1 :], -b[k], U[k, k + 1 :])


@kernel()
def _up(U, b):
    """Overwrite b by U^-1 b."""
    for k in range(len(U) - 1, -1, -1):
        b[k] = (b[k] - _dot(U[k, k + 1 :], b[k + 1 :])) / U[k, k]


@kernel(fastmath=_SUMS)
def _dot(a, b):
    """Return the sum of products of a and as many entries of b."""
    total = 0.0
    for s in range(len(a)):
        total += a[s] * b[s]
    return total


@kernel()
def _add(row, factor, other):
    """Add a multiple of as many entries of another row."""
    for b in range(len(row)):
        row[b] += factor * other[b]


@kernel()
def _divide(row, by):
    for b in range(len(row)):
        row[b] /= by


@kernel()
def _largest(values):
    """Return the largest size."""
    found = 0.0
    for value in values:
        found = max(found, abs(value))
    return found
