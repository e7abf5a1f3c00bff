"""The error-state filter over all its events: motion, covariance and measurements.

Helpers have signatures, so that each is compiled once; arrays are written number by number, which
takes a tenth of the time to compile that slices take.
"""

import math

import numba
import numpy as np

_GRAVITY = 9.80665
_LOG = math.log(2 * math.pi)


@numba.njit("void(f8[:,::1], f8[:,::1], f8[:,::1])", cache=True)
def _left(F, M, out):
    """Write F M; most of F are zeros."""
    for i in range(len(F)):
        for c in range(M.shape[1]):
            out[i, c] = 0.0
        for j in range(len(F)):
            factor = F[i, j]
            if factor != 0.0:
                for c in range(M.shape[1]):
                    out[i, c] += factor * M[j, c]


@numba.njit("void(f8[:,::1], f8[:,::1], f8[::1], i8, f8[:,::1], f8[:,::1])", cache=True)
def _spread(H, P, R, m, W, S):
    """Write H P, and H P H' + R."""
    n = len(P)
    for a in range(m):
        for j in range(n):
            W[a, j] = 0.0
        for i in range(n):
            factor = H[a, i]
            if factor != 0.0:
                for j in range(n):
                    W[a, j] += factor * P[i, j]
    for a in range(m):
        for b in range(m):
            total = R[a] if a == b else 0.0
            for i in range(n):
                total += W[a, i] * H[b, i]
            S[a, b] = total


@numba.njit("f8(f8[:,::1], f8[:,::1], i8, i8)", cache=True, error_model="numpy")
def _eliminate(S, B, m, columns):
    """Solve S X = B in place for a positive definite S; return the logarithm of det S."""
    logarithm = 0.0
    for a in range(m):
        logarithm += math.log(abs(S[a, a]))
        for b in range(a + 1, m):
            factor = S[b, a] / S[a, a]
            for c in range(a + 1, m):
                S[b, c] -= factor * S[a, c]
            for c in range(columns):
                B[b, c] -= factor * B[a, c]
    for a in range(m - 1, -1, -1):
        for b in range(a + 1, m):
            for c in range(columns):
                B[a, c] -= S[a, b] * B[b, c]
        for c in range(columns):
            B[a, c] /= S[a, a]
    return logarithm


@numba.njit("void(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[:,::1], i8)", cache=True)
def _joseph(P, gain, H, R, W, m):
    """Update P in Joseph's form by the transposed gain; `W` is H P."""
    n = len(P)
    for a in range(m):
        for i in range(n):
            factor = gain[a, i]
            for j in range(n):
                P[i, j] -= factor * W[a, j]
    # what remains is to multiply by (I - K H)', and to add K R K'
    for a in range(m):
        for i in range(n):
            total = -R[a] * gain[a, i]
            for j in range(n):
                total += P[i, j] * H[a, j]
            W[a, i] = total
    for a in range(m):
        for i in range(n):
            factor = W[a, i]
            for j in range(n):
                P[i, j] -= factor * gain[a, j]
    for i in range(n):
        for j in range(i):
            mean = 0.5 * (P[i, j] + P[j, i])
            P[i, j] = mean
            P[j, i] = mean


@numba.njit("void(f8, f8, f8, f8[:,::1])", cache=True, error_model="numpy")
def _turned(x, y, z, out):
    """Write the rotation matrix of a rotation vector, by Rodrigues' formula."""
    square = x * x + y * y + z * z
    size = math.sqrt(square)
    a, b = 1.0, 0.5
    if size >= 1e-6:
        a = math.sin(size) / size
        b = (1 - math.cos(size)) / square
    out[0, 0] = 1 - b * (y * y + z * z)
    out[0, 1] = b * x * y - a * z
    out[0, 2] = b * x * z + a * y
    out[1, 0] = b * x * y + a * z
    out[1, 1] = 1 - b * (x * x + z * z)
    out[1, 2] = b * y * z - a * x
    out[2, 0] = b * x * z - a * y
    out[2, 1] = b * y * z + a * x
    out[2, 2] = 1 - b * (x * x + y * y)


@numba.njit("void(f8[::1], f8[:,::1], f8[:,::1])", cache=True)
def _attitude(x, turn, out):
    """Write the attitude of a state, turned about axes of the body."""
    for i in range(3):
        for j in range(3):
            out[i, j] = (
                x[6 + 3 * i] * turn[0, j] + x[7 + 3 * i] * turn[1, j] + x[8 + 3 * i] * turn[2, j]
            )


@numba.njit("void(f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,:,::1])", cache=True)
def _strapdown(x, piece, densities, F, Q, work):
    """Integrate an INS over a piece; write its transition and covariance."""
    T, half, middle = piece[0], work[0], work[1]
    wx, wy, wz = (piece[1] - x[18]) * T, (piece[2] - x[19]) * T, (piece[3] - x[20]) * T
    fx, fy, fz = piece[4] - x[15], piece[5] - x[16], piece[6] - x[17]
    _turned(0.5 * wx, 0.5 * wy, 0.5 * wz, half)
    _attitude(x, half, middle)
    for i in range(3):
        a, b, c = middle[i, 0], middle[i, 1], middle[i, 2]
        acceleration = a * fx + b * fy + c * fz - (_GRAVITY if i == 2 else 0.0)
        x[i] += T * x[3 + i] + 0.5 * T * T * acceleration
        x[3 + i] += T * acceleration
        F[i, 3 + i] = T
        # minus T times the attitude and the cross product with the force
        a, b, c = T * (c * fy - b * fz), T * (a * fz - c * fx), T * (b * fx - a * fy)
        F[3 + i, 12], F[3 + i, 13], F[3 + i, 14] = -0.5 * T * a, -0.5 * T * b, -0.5 * T * c
        for j in range(3):
            # of the error of the attitude half a piece later
            F[3 + i, 6 + j] = a * half[j, 0] + b * half[j, 1] + c * half[j, 2]
            F[3 + i, 9 + j] = -T * middle[i, j]
            F[6 + i, 12 + j] = -T * half[j, i]
        for j in range(6, 15):
            F[i, j] = 0.5 * T * F[3 + i, j]
    _turned(wx, wy, wz, half)
    _attitude(x, half, middle)
    for i in range(3):
        for j in range(3):
            F[6 + i, 6 + j] = half[j, i]
            x[6 + 3 * i + j] = middle[i, j]
        for j in range(4):
            Q[3 + 3 * j + i, 3 + 3 * j + i] = densities[j] ** 2 * T


@numba.njit("void(f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1])", cache=True)
def _reckon(x, piece, densities, F, Q):
    """Go along a piece on the plane; write its transition and covariance."""
    T, speed = piece[0], piece[1]
    way, turn = T * speed * (1 + x[3]), T * (piece[2] - x[4])
    c, s, half = math.cos(x[2] + turn / 2), math.sin(x[2] + turn / 2), way / 2
    F[0, 2], F[0, 3], F[0, 4] = -way * s, T * speed * c, T * half * s
    F[1, 2], F[1, 3], F[1, 4], F[2, 4] = way * c, T * speed * s, -T * half * c, -T
    # the noise of the rate goes to the side as well
    along, side, turned = T * densities[0] ** 2, half * half, T * densities[1] ** 2
    Q[0, 0] = along * c * c + turned * side * s * s
    Q[0, 1] = (along - turned * side) * c * s
    Q[1, 0], Q[1, 1] = Q[0, 1], along * s * s + turned * side * c * c
    Q[0, 2], Q[1, 2] = -turned * half * s, turned * half * c
    Q[2, 0], Q[2, 1], Q[2, 2] = Q[0, 2], Q[1, 2], turned
    Q[3, 3], Q[4, 4] = T * densities[2] ** 2, T * densities[3] ** 2
    x[0] += way * c
    x[1] += way * s
    x[2] += turn
    x[5] = speed


@numba.njit("void(f8[::1], f8[::1], i8, f8[:,:,::1], f8[::1])", cache=True)
def _plus(x, error, d, work, out):
    """Write the state that lies an error from another one."""
    for i in range(len(x)):
        out[i] = x[i]
    if d == 5:
        for i in range(5):
            out[i] += error[i]
    else:
        turn, attitude = work[0], work[1]
        _turned(error[6], error[7], error[8], turn)
        _attitude(x, turn, attitude)
        for i in range(6):
            out[i] += error[i]
            out[15 + i] += error[9 + i]
        for i in range(9):
            out[6 + i] = attitude[i // 3, i % 3]
    for i in range(d, len(error)):
        out[len(x) - len(error) + i] += error[i]


@numba.njit("void(f8[::1], f8[::1], i8, f8[:,::1])", cache=True)
def _antenna(x, arm, d, out):
    """Write in three rows the derivatives by attitude or heading, and where it is in the last."""
    if d == 5:
        c, s = math.cos(x[2]), math.sin(x[2])
        ahead, left = arm[0] * c - arm[1] * s, arm[0] * s + arm[1] * c
        out[0, 0], out[1, 0], out[2, 0] = -left, ahead, 0.0
        out[3, 0], out[3, 1], out[3, 2] = x[0] + ahead, x[1] + left, 0.0
    else:
        for i in range(3):
            a, b, c = x[6 + 3 * i], x[7 + 3 * i], x[8 + 3 * i]
            out[i, 0] = c * arm[1] - b * arm[2]
            out[i, 1] = a * arm[2] - c * arm[0]
            out[i, 2] = b * arm[0] - a * arm[1]
            out[3, i] = x[i] + a * arm[0] + b * arm[1] + c * arm[2]


@numba.njit("f8(f8[::1], i8, f8[::1], i8, f8[::1])", cache=True)
def _moving(x, kind, u, d, row):
    """Return the velocity along an axis of the frame, or of the body; write its derivatives."""
    if d == 5:
        c, s = math.cos(x[2]), math.sin(x[2])
        row[2] = x[5] * (1 + x[3]) * (u[1] * c - u[0] * s)
        row[3] = x[5] * (u[0] * c + u[1] * s)
        return row[3] * (1 + x[3])
    for i in range(3):
        row[3 + i] = u[i]
        if kind == 3:
            row[3 + i] = x[6 + 3 * i] * u[0] + x[7 + 3 * i] * u[1] + x[8 + 3 * i] * u[2]
            a, b = (i + 1) % 3, (i + 2) % 3
            for c in range(3):  # the cross product of the axis and the velocity
                row[6 + i] += (u[a] * x[6 + 3 * c + b] - u[b] * x[6 + 3 * c + a]) * x[3 + c]
    return row[3] * x[3] + row[4] * x[4] + row[5] * x[5]


@numba.njit(
    "f8(f8[::1], i8, f8[::1], f8[::1], i8[::1], i8, f8[:,::1], f8[::1])",
    cache=True, error_model="numpy",
)  # fmt: skip
def _expected(x, kind, u, arm, own, d, antenna, row):
    """Return what is expected of a component; write its derivatives by the errors."""
    n = len(row)
    for i in range(n):
        row[i] = 0.0
    if kind >= 2:
        return _moving(x, kind, u, d, row)
    first, (a, b, c) = len(x) - n, (u[0], u[1], u[2])
    _antenna(x, arm, d, antenna)
    if kind == 0:
        found = a * antenna[3, 0] + b * antenna[3, 1] + c * antenna[3, 2]
    else:
        a, b, c = antenna[3, 0] - a, antenna[3, 1] - b, antenna[3, 2] - c
        found, factor = math.sqrt(a * a + b * b + c * c), 1.0
        if own[0] >= 0:
            factor += x[first + d + own[0]]
            row[d + own[0]] = found
        a, b, c = a * factor / found, b * factor / found, c * factor / found
        found *= factor
    row[0], row[1] = a, b
    if d == 5:
        row[2] = a * antenna[0, 0] + b * antenna[1, 0]
    else:
        row[2] = c
        for j in range(3):
            row[6 + j] = a * antenna[0, j] + b * antenna[1, j] + c * antenna[2, j]
    for k in range(1, 3):
        if own[k] >= 0:
            row[d + own[k]] = 1.0
            found += x[first + d + own[k]]
    return found


@numba.njit(
    "void(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1])", cache=True
)
def _propagate(F, Q, P, Phi, M, N, T):
    """Take P to F P F' + Q, and Phi to F Phi."""
    d, n = len(F), len(P)
    _left(F, P, M)
    for i in range(d):
        for j in range(d):
            N[j, i] = M[i, j]
    _left(F, N, T)  # F (F P)'
    for i in range(d):
        for j in range(d):
            P[i, j] = T[i, j] + Q[i, j]
        for j in range(d, n):
            P[i, j] = M[i, j]
            P[j, i] = M[i, j]
    _left(F, Phi, T)
    for i in range(d):
        for j in range(d):
            Phi[i, j] = T[i, j]


@numba.njit("void(f8[::1], f8[:,::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[::1])", cache=True)
def _colour(x, P, e, Phi, factors, gained, moved):
    """Take the own states and their covariances to the event, and errors by the transition."""
    d, n = len(Phi), len(P)
    for i in range(d, n):
        factor = factors[i - d]
        x[len(x) - n + i] *= factor
        e[i] *= factor
        for j in range(n):
            P[i, j] *= factor
        for j in range(n):
            P[j, i] *= factor
        P[i, i] += gained[i - d]
    for i in range(d):
        moved[i] = 0.0
        for j in range(d):
            moved[i] += Phi[i, j] * e[j]
    for i in range(d):
        e[i] = moved[i]


@numba.njit("void(f8[:,::1], f8[:,:,::1], i8)", cache=True)
def _keep(P, kept, k):
    for i in range(len(P)):
        for j in range(len(P)):
            kept[k, i, j] = P[i, j]


@numba.njit(cache=True, error_model="numpy")
def error_state(
    pieces, ends, densities, state, P, error, factors, gained, taken, begins, stops,
    kinds, vectors, arms, told, variances, owns, gate, feedback, kept,
):  # fmt: skip
    """Run it; see `inswsn_lib.estimation.error_state`."""
    planar, n, events, most = pieces.shape[1] == 3, len(P), len(ends), 1
    for j in range(len(begins)):
        most = max(most, stops[j] - begins[j])
    d, rows = 5 if planar else 15, events if kept else 0
    states, before = np.empty((rows, len(state))), np.empty((rows, len(state)))
    filtered, priors = np.empty((rows, n, n)), np.empty((rows, n, n))
    transitions = np.zeros((rows, n, n))
    values, deviations = np.empty(len(told)), np.empty(len(told))
    used, sizes = np.empty(len(told), np.bool_), np.zeros(len(begins), np.int64)
    squares = np.full(len(begins), np.nan)
    x, P, e, nominal, correction = state.copy(), P.copy(), error.copy(), state.copy(), np.zeros(n)
    F, Q, Phi = np.zeros((d, d)), np.zeros((d, d)), np.empty((d, d))
    T, N = np.empty((d, d)), np.empty((d, d))
    M, work, antenna = np.empty((d, n)), np.empty((2, 3, 3)), np.empty((4, 3))
    H, v, R = np.zeros((most, n)), np.empty(most), np.empty(most)
    W, S, B = np.empty((most, n)), np.empty((most, most)), np.empty((most, n + 1))
    count, piece, likelihood = 0, 0, 0.0

    for k in range(events):
        for i in range(d):
            F[i, i] = 1.0
            for j in range(d):
                Phi[i, j] = 1.0 if i == j else 0.0
        while piece < ends[k]:
            if planar:
                _reckon(x, pieces[piece], densities, F, Q)
            else:
                _strapdown(x, pieces[piece], densities, F, Q, work)
            _propagate(F, Q, P, Phi, M, N, T)
            piece += 1
        _colour(x, P, e, Phi, factors[k], gained[k], correction)
        if kept:
            _plus(x, e, d, work, before[k])
            _keep(P, priors, k)
            _keep(Phi, transitions, k)
            for i in range(d, n):
                transitions[k, i, i] = factors[k, i - d]
        for j in range(taken[k], taken[k + 1]):
            m, passed = 0, 0
            for c in range(begins[j], stops[j]):
                v[m] = told[c] - _expected(
                    x, kinds[c], vectors[c], arms[c], owns[c], d, antenna, H[m]
                )
                R[m] = variances[c]
                m += not math.isnan(v[m]) or kinds[c] == 1
            if m == 0:
                continue
            _spread(H, P, R, m, W, S)
            for a in range(m):
                for i in range(n):
                    v[a] -= H[a, i] * e[i]
                B[a, 0] = v[a]
                values[count + a], deviations[count + a] = v[a], math.sqrt(S[a, a])
                used[count + a] = v[a] * v[a] <= gate * S[a, a]
                if not used[count + a]:
                    likelihood -= 0.5 * (gate + _LOG + math.log(S[a, a]))
            _eliminate(S, B, m, 1)
            sizes[j], squares[j] = m, 0.0
            for a in range(m):
                squares[j] += v[a] * B[a, 0] / m
                if used[count + a]:  # the update is by these alone
                    for i in range(n):
                        H[passed, i] = H[a, i]
                    v[passed], R[passed] = v[a], R[a]
                    passed += 1
            count += m
            if passed == 0:
                continue
            _spread(H, P, R, passed, W, S)
            for a in range(passed):
                for i in range(n):
                    B[a, i] = W[a, i]
                B[a, n] = v[a]
            likelihood -= 0.5 * (_eliminate(S, B, passed, n + 1) + passed * _LOG)
            for i in range(n):
                correction[i] = 0.0
            for a in range(passed):
                likelihood -= 0.5 * v[a] * B[a, n]
                for i in range(n):
                    correction[i] += B[a, i] * v[a]
            _joseph(P, B, H, R, W, passed)
            if feedback:
                _plus(x, correction, d, work, nominal)
                for i in range(len(x)):
                    x[i] = nominal[i]
            else:
                for i in range(n):
                    e[i] += correction[i]
        if kept:
            _plus(x, e, d, work, states[k])
            _keep(P, filtered, k)
    return (
        states, before, filtered, priors, transitions, sizes, values[:count], deviations[:count],
        used[:count], squares, likelihood, x, P, e,
    )  # fmt: skip
