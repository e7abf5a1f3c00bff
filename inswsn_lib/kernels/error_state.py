"""The error-state filter over all its events: motion, covariance and measurements, run after run.

Between two steps of the covariance a sample changes sums alone (preintegration: Forster et al.,
IEEE Trans. Robotics 33(1), 2017): the attitude R, V = sum R f dt and S, the integral of V; A, the
integral of R, by which biases of the gyroscopes tilt, and B = sum [R f dt x] A, by which that tilt
pushes, with the integrals AA and BB. A step moves the nine errors of position, velocity and
attitude alone, with half of its noise before it and half after,

    P <- (I + M) (P + D T/2) (I + M)' + D T/2 .

The error that is not fed back is the last column of P, since what carries and corrects the one does
so with the other. Helpers have signatures, so that each is compiled once.
"""

import math

import numba
import numpy as np
from numba import types

# Standard gravity (m/s^2), where no Earth is given; of WGS84 the rate (rad/s), the semi-major axis
# (m), the squared eccentricity, gravity at the equator (m/s^2) and by how much it grows to the pole
_STANDARD = 9.80665
_RATE, _A, _E2, _EQUATOR = 7.292115e-5, 6378137.0, 6.6943799901413e-3, 9.7803253359
_GROWTH = math.sqrt(1 - _E2) * 9.8321849378 / _EQUATOR - 1
_MINOR = _A * math.sqrt(1 - _E2)
_LOG = math.log(2 * math.pi)

_SENSOR = types.float64(*[types.float64[::1]] * 4)
_MOST = 8  # functions of sensors
_FAST = {"cache": True, "error_model": "numpy", "fastmath": {"contract"}}


@numba.njit("void(f8, f8, f8, f8[:,::1])", **_FAST)
def _turned(x, y, z, out):
    """Write the rotation matrix of a rotation vector."""
    square = x * x + y * y + z * z
    if square < 0.01:
        a = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
        b = 0.5 - square / 24 * (1 - square / 30 * (1 - square / 56 * (1 - square / 90)))
    else:
        size = math.sqrt(square)
        a, b = math.sin(size) / size, (1 - math.cos(size)) / square
    out[0, 0] = 1 - b * (y * y + z * z)
    out[0, 1] = b * x * y - a * z
    out[0, 2] = b * x * z + a * y
    out[1, 0] = b * x * y + a * z
    out[1, 1] = 1 - b * (x * x + z * z)
    out[1, 2] = b * y * z - a * x
    out[2, 0] = b * x * z - a * y
    out[2, 1] = b * y * z + a * x
    out[2, 2] = 1 - b * (x * x + y * y)


@numba.njit("void(f8[:,::1], f8[:,::1], f8[:,::1])", **_FAST)
def _product(a, b, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@numba.njit("void(f8[::1], f8[:,:,::1])", **_FAST)
def _begin(x, sums):
    """Begin the sums with the attitude."""
    for k in range(7):
        for i in range(3):
            for j in range(3):
                sums[k, i, j] = x[6 + 3 * i + j] if k == 0 else 0.0


@numba.njit("void(f8[::1], f8, f8[::1], f8[::1], b1, f8[:,:,::1], f8[:,::1])", **_FAST)
def _add_sample(x, T, rate, force, increments, sums, turn):
    """Add a sample to the sums R, A, AA, B, BB, and V and S, which are rows of the sixth."""
    R, A, AA, B, BB, last, D = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6]
    if increments:
        wx, wy, wz = rate[0] - x[18] * T, rate[1] - x[19] * T, rate[2] - x[20] * T
        fx, fy, fz = force[0] - x[15] * T, force[1] - x[16] * T, force[2] - x[17] * T
    else:
        wx, wy, wz = (rate[0] - x[18]) * T, (rate[1] - x[19]) * T, (rate[2] - x[20]) * T
        _turned(0.5 * wx, 0.5 * wy, 0.5 * wz, turn)  # of the middle, where the force is felt
        a, b, c = (force[0] - x[15]) * T, (force[1] - x[16]) * T, (force[2] - x[17]) * T
        fx = turn[0, 0] * a + turn[0, 1] * b + turn[0, 2] * c
        fy = turn[1, 0] * a + turn[1, 1] * b + turn[1, 2] * c
        fz = turn[2, 0] * a + turn[2, 1] * b + turn[2, 2] * c
    _turned(wx, wy, wz, turn)
    for i in range(3):
        a, b, c = R[i, 0], R[i, 1], R[i, 2]
        last[2, i] = a * fx + b * fy + c * fz
        last[1, i] += T * (last[0, i] + 0.5 * last[2, i])
        last[0, i] += last[2, i]
        for j in range(3):
            new = a * turn[0, j] + b * turn[1, j] + c * turn[2, j]
            D[i, j] = 0.25 * T * (R[i, j] + new)  # half of what A grows by
            A[i, j] += D[i, j]
            AA[i, j] += T * A[i, j]
            R[i, j] = new
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            step = last[2, k] * A[m, j] - last[2, m] * A[k, j]
            BB[i, j] += T * (B[i, j] + 0.5 * step)
            B[i, j] += step
    for i in range(3):
        for j in range(3):
            A[i, j] += D[i, j]


@numba.njit("f8(f8[::1], f8[::1], f8, f8[::1], f8[::1])", **_FAST)
def _gravity(place, velocity, ahead, earth, out):
    """Write gravity at the place some time ahead, and return its size.

    As `Ground.gravity` of `inswsn_lib.inertial.earth`.
    """
    if earth[3] == 0.0:
        out[0], out[1], out[2] = 0.0, 0.0, -_STANDARD
        return _STANDARD
    polar, level = earth[0], earth[1]
    east = place[0] + ahead * velocity[0]
    north = place[1] + ahead * velocity[1] + earth[2]
    up = place[2] + ahead * velocity[2] + earth[3]
    along, outward = polar * north + level * up, polar * up - level * north
    across = math.sqrt(east * east + outward * outward)
    p, q = _A * along, _MINOR * across
    size = 1 / math.sqrt(p * p + q * q)
    p, q = p * size, q * size
    s = along + _E2 / (1 - _E2) * _MINOR * p * p * p
    c = across - _E2 * _A * q * q * q
    size = 1 / math.sqrt(s * s + c * c)
    s, c = s * size, c * size
    root = math.sqrt(1 - _E2 * s * s)
    height = across * c + along * s - _A * root
    g = _EQUATOR * (1 + _GROWTH * s * s) / root * (1 - 2 * height / _A)
    radial = c * outward / across
    out[0] = -g * c * east / across
    out[1] = -g * (polar * s - level * radial)
    out[2] = -g * (level * s + polar * radial)
    return g


@numba.njit("void(f8[::1], f8, f8[:,:,::1], f8[::1], f8[:,::1], f8[:,:,::1])", **_FAST)
def _step(x, T, sums, earth, M, work):
    """Take the state over the time of the sums, and write by what errors grow."""
    R, A, AA, B, BB, last = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]
    V, S, extra = last[0], last[1], last[2]
    size = _gravity(x[:3], x[3:6], 0.5 * T, earth, extra)
    wy, wz = _RATE * earth[0], _RATE * earth[1]
    if earth[3] != 0.0:
        # Coriolis by the way, and what turns the force as the frame turns: the integral of t R f is
        # T V - S, which grows with the square of the time, so that a third of it is its mean
        a, b, c = T * V[0] - S[0], T * V[1] - S[1], T * V[2] - S[2]
        p = 2 * (T * x[3] + S[0] + 0.5 * T * T * extra[0]) + a
        q = 2 * (T * x[4] + S[1] + 0.5 * T * T * extra[1]) + b
        r = 2 * (T * x[5] + S[2] + 0.5 * T * T * extra[2]) + c
        extra[0] -= (wy * r - wz * q) / T
        extra[1] -= wz * p / T
        extra[2] += wy * p / T
        x[0] += T / 6 * (wy * c - wz * b)
        x[1] += T / 6 * wz * a
        x[2] -= T / 6 * wy * a
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        p, q, r = x[6 + 3 * k], x[7 + 3 * k], x[8 + 3 * k]
        u, v, w = x[6 + 3 * m], x[7 + 3 * m], x[8 + 3 * m]
        # minus V and S times the attitude at the begin
        M[3 + i, 6], M[3 + i, 7] = V[m] * p - V[k] * u, V[m] * q - V[k] * v
        M[3 + i, 8] = V[m] * r - V[k] * w
        M[i, 6], M[i, 7], M[i, 8] = S[m] * p - S[k] * u, S[m] * q - S[k] * v, S[m] * r - S[k] * w
        M[i, 3 + i] = T
        for j in range(3):
            M[3 + i, 9 + j], M[3 + i, 12 + j] = -A[i, j], B[i, j]
            M[i, 9 + j], M[i, 12 + j] = -AA[i, j], BB[i, j]
            # transposed, the attitude at the end times that at the begin, and times A
            a, b, c = R[0, i], R[1, i], R[2, i]
            M[6 + i, 6 + j] = a * x[6 + j] + b * x[9 + j] + c * x[12 + j]
            M[6 + i, 12 + j] = -(a * A[0, j] + b * A[1, j] + c * A[2, j])
        M[6 + i, 6 + i] -= 1.0
    if earth[3] != 0.0:
        M[3, 4], M[3, 5], M[4, 3], M[5, 3] = 2 * T * wz, -2 * T * wy, -2 * T * wz, 2 * T * wy
        M[3, 0] = M[4, 1] = -T * size / _A
        M[5, 2] = 2 * T * size / _A
    for i in range(3):
        x[i] += T * x[3 + i] + S[i] + 0.5 * T * T * extra[i]
        x[3 + i] += V[i] + T * extra[i]
    _turned(0.0, -T * wy, -T * wz, work[0])
    _product(work[0], R, work[1])
    for i in range(9):
        x[6 + i] = work[1, i // 3, i % 3]


@numba.njit("void(f8[::1], f8, f8, f8, f8[::1], f8[:,::1], f8[:,::1])", **_FAST)
def _reckon(x, T, speed, rate, densities, M, Q):
    """Go along a piece on the plane; write by what errors grow, and the covariance it adds."""
    way, turn = T * speed * (1 + x[3]), T * (rate - x[4])
    c, s, half = math.cos(x[2] + turn / 2), math.sin(x[2] + turn / 2), way / 2
    M[0, 2], M[0, 3], M[0, 4] = -way * s, T * speed * c, T * half * s
    M[1, 2], M[1, 3], M[1, 4], M[2, 4] = way * c, T * speed * s, -T * half * c, -T
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


@numba.njit("void(f8[:,::1], f8[:,::1], f8[:,::1])", **_FAST)
def _carry(M, P, W):
    """Take P, with the error as its last column, by I + M, which has the rows that move alone."""
    moved, columns, n = M.shape[0], M.shape[1], len(P)
    for i in range(moved):
        for j in range(n + 1):
            W[i, j] = P[i, j]
        for k in range(columns):
            share = M[i, k]
            if share != 0.0:
                for j in range(n + 1):
                    W[i, j] += share * P[k, j]
    for i in range(moved):
        for j in range(i + 1):
            total = W[i, j]
            for k in range(columns):
                total += W[i, k] * M[j, k]
            P[i, j] = total
            P[j, i] = total
        for j in range(moved, n):
            P[i, j] = W[i, j]
            P[j, i] = W[i, j]
        P[i, n] = W[i, n]


@numba.njit("void(f8[:,::1], f8[:,::1], f8[:,::1])", **_FAST)
def _append(M, Phi, W):
    """Take a transition by I + M."""
    d = len(Phi)
    for i in range(len(M)):
        for j in range(d):
            W[i, j] = Phi[i, j]
        for k in range(d):
            share = M[i, k]
            if share != 0.0:
                for j in range(d):
                    W[i, j] += share * Phi[k, j]
    for i in range(len(M)):
        for j in range(d):
            Phi[i, j] = W[i, j]


@numba.njit("void(f8[:,::1], f8[::1], f8)", **_FAST)
def _shake(P, densities, T):
    """Add white noise of an IMU."""
    for j in range(4):
        for i in range(3 + 3 * j, 6 + 3 * j):
            P[i, i] += densities[j] * densities[j] * T


@numba.njit("void(f8[::1], f8[:,::1], i8, f8[::1], f8[::1])", **_FAST)
def _colour(x, P, d, factors, gained):
    """Take the own states, with their covariances and errors, to the event."""
    n = len(P)
    for i in range(d, n):
        factor = factors[i - d]
        x[len(x) - n + i] *= factor
        for j in range(n + 1):
            P[i, j] *= factor
        for j in range(n):
            P[j, i] *= factor
        P[i, i] += gained[i - d]


@numba.njit("void(f8[::1], f8[:,::1], i8, f8[:,:,::1], f8[::1])", **_FAST)
def _plus(x, P, d, work, out):
    """Write the state that lies the error from another one."""
    n = len(P)
    for i in range(len(x)):
        out[i] = x[i]
    if d == 5:
        for i in range(5):
            out[i] += P[i, n]
    else:
        _turned(P[6, n], P[7, n], P[8, n], work[0])
        for i in range(3):
            a, b, c = x[6 + 3 * i], x[7 + 3 * i], x[8 + 3 * i]
            for j in range(3):
                out[6 + 3 * i + j] = a * work[0, 0, j] + b * work[0, 1, j] + c * work[0, 2, j]
        for i in range(6):
            out[i] += P[i, n]
            out[15 + i] += P[9 + i, n]
    for i in range(d, n):
        out[len(x) - n + i] += P[i, n]


@numba.njit("void(f8[::1], f8[:,::1], i8, i8, f8[:,:,::1], f8[::1])", **_FAST)
def _feed_back(x, P, count, d, work, out):
    """Take the first errors into the state."""
    _plus(x, P, d, work, out)
    for i in range(len(x) - len(P) + count):
        x[i] = out[i]
    for i in range(count):
        P[i, len(P)] = 0.0


@numba.njit("void(f8[:,::1], f8[:,::1])", **_FAST)
def _turn_attitude(P, turn):
    """Keep the covariance of the attitude about axes of the frame where the body is turned."""
    n = len(P)
    _turned(P[6, n], P[7, n], P[8, n], turn)
    for i in range(n):
        a, b, c = P[6, i], P[7, i], P[8, i]
        for j in range(3):
            P[6 + j, i] = turn[0, j] * a + turn[1, j] * b + turn[2, j] * c
    for i in range(n):
        a, b, c = P[i, 6], P[i, 7], P[i, 8]
        for j in range(3):
            P[i, 6 + j] = turn[0, j] * a + turn[1, j] * b + turn[2, j] * c


@numba.njit("void(f8[::1], i8, f8[::1])", **_FAST)
def _show(x, d, seen):
    """Write what sensors see of a state: position, velocity, attitude and biases, (21,)."""
    if d == 15:
        for i in range(21):
            seen[i] = x[i]
        return
    c, s, speed = math.cos(x[2]), math.sin(x[2]), x[5] * (1 + x[3])
    seen[0], seen[1], seen[3], seen[4] = x[0], x[1], speed * c, speed * s
    seen[6], seen[7], seen[9], seen[10], seen[14] = c, -s, s, c, 1.0


@numba.njit("void(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8, f8[::1])", **_FAST)
def _fill_row(x, seen, arm, own, row, d, out):
    """Write derivatives by the errors, of those by what the sensor at a lever arm saw."""
    a = seen[6] * row[0] + seen[9] * row[1] + seen[12] * row[2]
    b = seen[7] * row[0] + seen[10] * row[1] + seen[13] * row[2]
    c = seen[8] * row[0] + seen[11] * row[1] + seen[14] * row[2]
    row[6] += arm[1] * c - arm[2] * b
    row[7] += arm[2] * a - arm[0] * c
    row[8] += arm[0] * b - arm[1] * a
    for i in range(len(out)):
        out[i] = 0.0
    if d == 15:
        for i in range(15):
            out[i] = row[i]
    else:
        out[0], out[1] = row[0], row[1]
        out[2] = row[8] + row[4] * seen[3] - row[3] * seen[4]
        out[3] = x[5] * (row[3] * seen[6] + row[4] * seen[9])
    first = d + int(own[0])
    for i in range(int(own[1])):
        out[first + i] = row[15 + i]


@numba.njit("void(f8[:,::1], f8[:,::1], f8[::1], f8[::1], i8, f8[:,::1], f8[:,::1])", **_FAST)
def _spread(H, P, R, v, m, W, S):
    """Write H P and H P H' + R, and take from v what the error makes of it."""
    n = len(P)
    for a in range(m):
        for j in range(n + 1):
            W[a, j] = 0.0
        for i in range(n):
            factor = H[a, i]
            if factor != 0.0:
                for j in range(n + 1):
                    W[a, j] += factor * P[i, j]
        v[a] -= W[a, n]
    for a in range(m):
        for b in range(m):
            total = R[a] if a == b else 0.0
            for i in range(n):
                total += W[a, i] * H[b, i]
            S[a, b] = total


@numba.njit("f8(f8[:,::1], f8[:,::1], f8[::1], f8[::1], i8)", **_FAST)
def _factor(S, L, v, white, m):
    """Write the factor of Cholesky, and v whitened by it; return the logarithm of det S."""
    logarithm = 0.0
    for a in range(m):
        white[a] = v[a]
        for b in range(a + 1):
            total = S[a, b]
            for c in range(b):
                total -= L[a, c] * L[b, c]
            L[a, b] = total / L[b, b] if b < a else math.sqrt(total)
            white[a] -= L[a, b] * white[b] if b < a else 0.0
        white[a] /= L[a, a]
        logarithm += 2 * math.log(L[a, a])
    return logarithm


@numba.njit(
    "void(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], i8)", **_FAST
)
def _update(P, L, H, R, v, W, B, m):
    """Update P and the error in Joseph's form; `W` is H P, `B` becomes the transposed gain."""
    n = len(P)
    for a in range(m):
        for i in range(n):
            B[a, i] = W[a, i]
        for b in range(a):
            for i in range(n):
                B[a, i] -= L[a, b] * B[b, i]
        for i in range(n):
            B[a, i] /= L[a, a]
    for a in range(m - 1, -1, -1):
        for b in range(a + 1, m):
            for i in range(n):
                B[a, i] -= L[b, a] * B[b, i]
        for i in range(n):
            B[a, i] /= L[a, a]
    for i in range(n):
        for a in range(m):
            factor = B[a, i]
            P[i, n] += factor * v[a]
            for j in range(n):
                P[i, j] -= factor * W[a, j]
    # what remains is to multiply by (I - K H)', and to add K R K'
    for a in range(m):
        for i in range(n):
            W[a, i] = -R[a] * B[a, i]
        for k in range(n):
            factor = H[a, k]
            if factor != 0.0:
                for i in range(n):
                    W[a, i] += factor * P[i, k]
    for i in range(n):
        for a in range(m):
            factor = W[a, i]
            for j in range(n):
                P[i, j] -= factor * B[a, j]
    for i in range(n):
        for j in range(i):
            mean = 0.5 * (P[i, j] + P[j, i])
            P[i, j] = mean
            P[j, i] = mean


@numba.njit("void(f8[:,::1], f8[:,::1])", **_FAST)
def _keep(P, kept):
    for i in range(len(P)):
        for j in range(len(P)):
            kept[i, j] = P[i, j]


_RUN = (
    types.UniTuple(types.FunctionType(_SENSOR), _MOST),
    *(types.float64[::1], types.float64[:, :, ::1], types.float64[:, :, ::1], types.boolean),
    *(types.int64[::1], types.float64[::1], types.float64, types.float64[::1]),
    *(types.int64[::1], types.int64[::1]),
    *(types.float64[:, ::1], types.float64[:, :, ::1], types.float64[:, ::1]),
    *(types.float64[:, ::1], types.float64[:, ::1]),
    *(types.int64[::1], types.int64[::1], types.int64[::1]),
    *(types.int64[::1], types.float64[:, ::1], types.float64[:, ::1], types.float64[:, ::1]),
    *(types.float64[:, ::1], types.float64[:, ::1], types.int64, types.int64),
)


@numba.njit(_RUN, **_FAST)
def error_state(
    sensors, lengths, rates, forces, increments, ends, densities, substep, earth, which, offsets,
    starts, covariances, errors, factors, gained, taken, begins, stops, kinds, data, arms, noise,
    owns, told, mode, kept,
):  # fmt: skip
    """Run it; see `inswsn_lib.inertial.error_state`."""
    runs, events, n, most = len(starts), len(ends), covariances.shape[1], 1
    numbers, d = starts.shape[1], 15 if rates.shape[2] == 3 else 5
    for j in range(len(begins)):
        most = max(most, stops[j] - begins[j])
    some, all_ = events if kept > 0 else 0, events if kept > 1 else 0
    states, before = np.empty((some, runs, numbers)), np.empty((all_, runs, numbers))
    filtered, priors = np.empty((some, runs, n, n)), np.empty((all_, runs, n, n))
    transitions, left = np.zeros((all_, runs, n, n)), np.empty((some, runs, n))
    firsts = np.empty((some, runs, 3))
    spreads = np.zeros((len(begins) if kept == 1 else 0, runs, most, most))
    values, deviations = np.full(told.shape, np.nan), np.full(told.shape, np.nan)
    used, squares = np.zeros(told.shape, np.bool_), np.full((runs, len(begins)), np.nan)
    likelihoods, ended = np.zeros(runs), starts.copy()
    last, errors = covariances.copy(), errors.copy()
    P, Phi, out = np.empty((n, n + 1)), np.empty((d, d)), np.empty(numbers)
    M, Q = np.zeros((9 if d == 15 else 3, d)), np.zeros((5, 5))
    sums, work, W = np.zeros((7, 3, 3)), np.empty((2, 3, 3)), np.empty((max(most, 9), n + 1))
    H, v, R, white = np.zeros((most, n)), np.empty(most), np.empty(most), np.empty(most)
    S, L, B = np.empty((most, most)), np.empty((most, most)), np.empty((most, n))
    seen, row, place = np.zeros(21), np.empty(15 + n), np.empty(3)
    there, piece_before = np.empty(most, np.int64), 0

    for r in range(runs):
        x, offset, piece_before = ended[r], offsets[r], 0
        rate, force = rates[which[r]], forces[which[r]]
        for i in range(n):
            P[i, n] = errors[r, i]
            for j in range(n):
                P[i, j] = covariances[r, i, j]
        for k in range(events):
            if kept > 1:
                for i in range(d):
                    for j in range(d):
                        Phi[i, j] = 1.0 if i == j else 0.0
            T = 0.0
            for piece in range(piece_before, ends[k]):
                here = offset + piece
                if d == 5:
                    _reckon(x, lengths[piece], rate[here, 0], rate[here, 1], densities, M, Q)
                else:
                    if T == 0.0:
                        _begin(x, sums)
                    _add_sample(
                        x, lengths[piece], rate[here], force[here], increments, sums, work[0]
                    )
                    T += lengths[piece]
                    if substep > T and piece + 1 < ends[k]:
                        continue
                    _step(x, T, sums, earth, M, work)
                    _shake(P, densities, 0.5 * T)
                _carry(M, P, W)
                if d == 15:
                    _shake(P, densities, 0.5 * T)
                    T = 0.0
                else:
                    for i in range(5):
                        for j in range(5):
                            P[i, j] += Q[i, j]
                if kept > 1:
                    _append(M, Phi, W)
            piece_before = ends[k]
            _colour(x, P, d, factors[k], gained[k])
            if kept > 1:
                _plus(x, P, d, work, before[k, r])
                _keep(P, priors[k, r])
                _keep(Phi, transitions[k, r])
                for i in range(d, n):
                    transitions[k, r, i, i] = factors[k, i - d]
            for j in range(taken[k], taken[k + 1]):
                m, passed = 0, 0
                _show(x, d, seen)
                for i in range(3):
                    place[i] = seen[i]
                for c in range(begins[j], stops[j]):
                    if math.isnan(told[r, c]):
                        continue
                    arm, own, count = arms[c], owns[c], 15 + int(owns[c, 1])
                    for i in range(3):
                        seen[i] = place[i] + (
                            seen[6 + 3 * i] * arm[0] + seen[7 + 3 * i] * arm[1]
                            + seen[8 + 3 * i] * arm[2]
                        )  # fmt: skip
                    for i in range(count):
                        row[i] = 0.0
                    first = numbers - n + d + int(own[0])
                    v[m] = told[r, c] - sensors[kinds[c]](
                        seen, x[first : first + count - 15], data[c], row[:count]
                    )
                    if noise[c, 2] > 0.0:
                        v[m] -= noise[c, 2] * math.floor(v[m] / noise[c, 2] + 0.5)
                    _fill_row(x, seen, arm, own, row, d, H[m])
                    R[m], there[m] = noise[c, 0], c
                    m += 1
                if m > 0:
                    _spread(H, P, R, v, m, W, S)
                    logarithm = _factor(S, L, v, white, m)
                    square = 0.0
                    if kept == 1:
                        for a in range(m):
                            for b in range(m):
                                spreads[j, r, there[a] - begins[j], there[b] - begins[j]] = S[a, b]
                    for a in range(m):
                        c = there[a]
                        square += white[a] * white[a]
                        values[r, c], deviations[r, c] = v[a], math.sqrt(S[a, a])
                        used[r, c] = v[a] * v[a] <= noise[c, 1] * S[a, a]
                        if not used[r, c]:
                            likelihoods[r] -= 0.5 * (noise[c, 1] + _LOG + math.log(S[a, a]))
                            continue
                        # the update is by these alone
                        if passed < a:
                            for i in range(n):
                                H[passed, i], W[passed, i] = H[a, i], W[a, i]
                            v[passed], R[passed], there[passed] = v[a], R[a], a
                        else:
                            there[passed] = a
                        passed += 1
                    squares[r, j] = square / m
                    if 0 < passed < m:
                        for a in range(passed):
                            for b in range(passed):
                                S[a, b] = S[there[a], there[b]]
                        logarithm, square = _factor(S, L, v, white, passed), 0.0
                        for a in range(passed):
                            square += white[a] * white[a]
                    if passed > 0:
                        likelihoods[r] -= 0.5 * (logarithm + passed * _LOG + square)
                        _update(P, L, H, R, v, W, B, passed)
                        if mode == 1:
                            _feed_back(x, P, n, d, work, out)
                if kept == 1 and j == taken[k]:
                    for i in range(3):
                        firsts[k, r, i] = x[i] + P[i, n]
            if mode == 2:
                if d == 15:
                    _turn_attitude(P, work[0])
                _feed_back(x, P, d, d, work, out)
            if kept > 0:
                _keep(P, filtered[k, r])
                for i in range(numbers):
                    states[k, r, i] = x[i]
                for i in range(n):
                    left[k, r, i] = P[i, n]
                if kept > 1:
                    _plus(x, P, d, work, states[k, r])
        _keep(P, last[r])
        for i in range(n):
            errors[r, i] = P[i, n]
    return (
        states, before, filtered, priors, transitions, left, firsts, values, deviations, used,
        squares, spreads, likelihoods, ended, last, errors,
    )  # fmt: skip
