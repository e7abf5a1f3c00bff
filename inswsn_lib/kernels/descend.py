"""Damped Gauss-Newton iteration of positions from ranges, runs of a place side by side."""

from __future__ import annotations

import numpy as np

from inswsn_lib.kernels.choice import kernel

_LANES = 64
_CUSP = 1e-9  # m, the least distance from a node


@kernel(error_model="numpy", fastmath={"contract"})
def descend(nodes, r, weight, start, limits):
    """Return positions (2, places, runs); arguments as in `simulation.multilateration`."""
    least, iterations, damp, stuck, small, flat = limits
    places, runs = r.shape[1:]
    found = start.copy()
    sums, new = np.empty((6, _LANES)), np.empty((6, _LANES))
    here, tried = np.empty((2, _LANES)), np.empty((2, _LANES))
    damping, enough = np.empty(_LANES), np.empty(_LANES, np.bool_)
    for place in range(places):
        for first in range(0, runs, _LANES):
            width = min(_LANES, runs - first)
            for q in range(width):
                here[0, q], here[1, q] = start[0, place, first + q], start[1, place, first + q]
                heard, damping[q] = 0.0, 0.0
                for i in range(len(r)):
                    heard += weight[i, place, first + q]
                enough[q] = heard >= least
            _moments(nodes, r, weight, place, first, width, here, sums)
            for _ in range(iterations):
                for q in range(width):
                    a, b, d, u, v = sums[1, q], sums[2, q], sums[3, q], sums[4, q], sums[5, q]
                    level = a * d - b * b <= flat * max(a + d, 1e-300) ** 2
                    a, d = a * (1 + damping[q]) + damping[q], d * (1 + damping[q]) + damping[q]
                    whole = a * d - b * b
                    east, north = (d * u - b * v) / whole, (a * v - b * u) / whole
                    stays = level and damping[q] == 0
                    tried[0, q] = here[0, q] + (east if np.isfinite(east) and not stays else 0.0)
                    tried[1, q] = here[1, q] + (north if np.isfinite(north) and not stays else 0.0)
                _moments(nodes, r, weight, place, first, width, tried, new)
                on = False
                for q in range(width):
                    if new[0, q] < sums[0, q]:
                        here[0, q], here[1, q] = tried[0, q], tried[1, q]
                        for i in range(6):
                            sums[i, q] = new[i, q]
                        damping[q] /= 10
                    else:  # a step that makes it worse is tried again, shorter
                        damping[q] = min(max(10 * damping[q], damp), 10 * stuck)
                    # at a node the cost has a cusp: there no step, however short, makes it smaller
                    steep = max(abs(sums[4, q]), abs(sums[5, q]))
                    on |= enough[q] and not (steep < small or damping[q] > stuck)
                if not on:
                    break
            for q in range(width):
                found[0, place, first + q], found[1, place, first + q] = here[0, q], here[1, q]
    return found


@kernel(error_model="numpy", fastmath={"contract"})
def _moments(nodes, r, weight, place, first, width, at, out):
    """Set out to the cost, the entries of J'J, and the gradient J'e of positions."""
    for i in range(6):
        for q in range(width):
            out[i, q] = 0.0
    for i in range(len(r)):
        x, y = nodes[i, 0, place, 0], nodes[i, 1, place, 0]
        for q in range(width):
            east, north, w = at[0, q] - x, at[1, q] - y, weight[i, place, first + q]
            away = max(np.sqrt(east * east + north * north), _CUSP)
            miss = w * (r[i, place, first + q] - away)
            east, north = east / away, north / away
            out[0, q] += miss * miss
            out[1, q] += w * east * east
            out[2, q] += w * east * north
            out[3, q] += w * north * north
            out[4, q] += east * miss
            out[5, q] += north * miss
