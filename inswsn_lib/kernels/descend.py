"""Positions of least squares from ranges, one after the other."""

from __future__ import annotations

import numpy as np

from inswsn_lib.kernels.choice import kernel

_CUSP = 1e-9  # m, the least distance from an anchor


@kernel(error_model="numpy", fastmath={"contract"})
def descend(place, height, distance, windows, start, scale, limits):
    """Return positions (windows, d); arguments as in `simulation.position_search`."""
    iterations, damp, stuck, small, flat = limits
    d, found = place.shape[1], start.copy()
    tried, solved = np.empty(d), np.empty((d, d + 1))
    equations, new = np.empty((d, d + 1)), np.empty((d, d + 1))
    for w in range(len(windows)):
        first = windows[w]
        last = windows[w + 1] if w + 1 < len(windows) else len(distance)
        here, damping = found[w], 0.0
        cost = _equations(place, height, distance, first, last, here, scale, equations)
        for _ in range(iterations):
            step = _solved(equations, damping, flat, solved)
            for i in range(d):
                tried[i] = here[i] + (solved[i, d] if step else 0.0)
            new_cost = _equations(place, height, distance, first, last, tried, scale, new)
            if new_cost < cost:
                cost, damping = new_cost, damping / 10
                for i in range(d):
                    here[i] = tried[i]
                    for j in range(d + 1):
                        equations[i, j] = new[i, j]
            else:  # a step that makes it worse is tried again, shorter
                damping = min(max(10 * damping, damp), 10 * stuck)
            steep = 0.0
            for i in range(d):
                steep = max(steep, abs(equations[i, d]))
            # at an anchor the cost has a cusp: there no step, however short, makes it smaller
            if steep < small or damping > stuck:
                break
    return found


@kernel(error_model="numpy", fastmath={"contract"})
def _equations(place, height, distance, first, last, at, scale, out):
    """Set out (d, d + 1) to the normal equations J'WJ and J'We of a position; return the cost."""
    d, cost = len(at), 0.0
    for i in range(d):
        for j in range(d + 1):
            out[i, j] = 0.0
    for k in range(first, last):
        square = height[k] * height[k]
        for i in range(d):
            square += (at[i] - place[k, i]) ** 2
        away = max(np.sqrt(square), _CUSP)
        miss, weight = distance[k] - away, 1.0
        if scale < np.inf:
            root = np.sqrt(1.0 + (miss / scale) ** 2)
            weight = 1.0 / root
            cost += 2.0 * miss * miss / (1.0 + root)  # without the cancellation in root - 1
        else:
            cost += miss * miss
        for i in range(d):
            slope = weight * (at[i] - place[k, i]) / away
            for j in range(i + 1):
                out[i, j] += slope * (at[j] - place[k, j]) / away
            out[i, d] += slope * miss
    for i in range(d):
        for j in range(i):
            out[j, i] = out[i, j]
    return cost


@kernel(error_model="numpy", fastmath={"contract"})
def _solved(equations, damping, flat, out):
    """Set the last column of out to the damped step; tell whether it may be taken."""
    d, trace, whole = len(out), 0.0, 1.0
    for i in range(d):
        trace += equations[i, i]
        for j in range(d + 1):
            out[i, j] = equations[i, j]
        out[i, i] += damping * (1.0 + equations[i, i])
    for p in range(d):
        whole *= out[p, p]
        for i in range(d):
            if i != p:
                factor = out[i, p] / out[p, p]
                for j in range(p, d + 1):
                    out[i, j] -= factor * out[p, j]
    sound = damping > 1e-9 or whole > flat * max(trace, 1e-300) ** d
    for i in range(d):
        out[i, d] /= out[i, i]
        sound &= np.isfinite(out[i, d])
    return sound
