"""The pictures and the record of the lesson on a car that does not slide."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inswsn_book import record as book
from inswsn_book.evidence.outage_cells import rebuild_outages, rebuild_recorded
from inswsn_book.show.moving import Chart, Moving, Slider, ellipse
from inswsn_lib.checks import Array
from inswsn_lib.inertial import metres
from inswsn_lib.navigation import (
    OutageTrials,
    RecordedTrials,
    VehicleOutages,
    read_trials,
    with_aids,
)
from inswsn_lib.papers import read_numbers
from inswsn_lib.simulation import Drive
from inswsn_lib.vehicle import FilterSettings, VehicleRun, VehicleState, position_error, replay, yaw

Parts = tuple[Array, Array]  # of an error: along and across
Said = dict[str, tuple[float, str, str]]  # numbers of the text: value, unit, and how it is made
#: Positions (m) after each second, of a start turned by an angle, with a bias of the gyros
Navigate = Callable[..., Array]
#: The spread of a velocity east and north after the car has looked at its own sideways velocity
Constrain = Callable[[Array, float], Array]
#: Positions (seconds + 1, 3) from the start on, and their covariances, through an outage by hand
Outage = Callable[[int, Sequence[str]], tuple[Array, Array]]

#: The aids of an outage, and what they are called
AIDS: dict[str, tuple[str, ...]] = {
    "none": (),
    "compass": ("compass",),
    "constraint": ("constraint",),
    "both": ("compass", "constraint"),
}
#: When outages begin, s, and how long they last
STARTS = np.arange(100, 1450, 10)
LENGTH = 40
#: An outage is lost that ends so far off, m; a road is straight that turns by less, degrees
LOST, STRAIGHT = 20, 15
_GRAVITY = 9.795  # m/s²


def outages(drive: Drive, told: FilterSettings, known: VehicleRun, aids: str) -> VehicleRun:
    """Return the library's filter with some aids through an outage from each of `STARTS` on.

    Until then it is the filter that is known: with satellites and all aids.
    """
    there, believed = with_aids(drive, told, AIDS[aids])
    return replay(there, believed, known, STARTS, LENGTH, aiding=True)


def turned(drive: Drive) -> Array:
    """Return how far the heading goes in each outage, from its least to its most, degrees."""
    assert drive.reference.attitude is not None
    heading = np.degrees(np.unwrap(yaw(drive.reference.attitude)))
    return np.array([np.ptp(heading[k : k + LENGTH + 1]) for k in STARTS])


def along_across(error: Array, heading: Array) -> tuple[Array, Array]:
    """Return parts of errors east and north, (..., 2), along a heading and to its right."""
    sine, cosine = np.sin(heading), np.cos(heading)
    east, north = error[..., 0], error[..., 1]
    return sine * east + cosine * north, cosine * east - sine * north


def parts(run: VehicleRun, drive: Drive) -> tuple[Array, Array]:
    """Return errors of position along the road and across it, each (steps, runs), m."""
    assert drive.reference.attitude is not None
    heading = yaw(drive.reference.attitude)[run.epochs]
    return along_across(np.moveaxis(position_error(run, drive), 1, 2), heading)


def rms(values: Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def in_metres(state: VehicleState) -> tuple[Array, Array, Array, Array]:
    """Return velocity, attitude, biases (6,) and covariance of a state, east, north, up in m."""
    size = np.diag(np.concatenate([metres(state.position), np.ones(12)]))
    size = size[[1, 0, *range(2, 15)]]  # latitude stands before longitude
    biases = np.concatenate([state.accelerometer_bias, state.gyro_drift])
    return state.velocity, state.attitude, biases, size @ state.covariance @ size.T


def path(run: VehicleRun) -> Array:
    """Return where a run went, from its start, east, north, up, (steps, 3), m."""
    start = run.position[0, :, 0]
    return ((run.position[:, :, 0] - start) * metres(start))[:, [1, 0, 2]]


def show_drive(drive: Drive, told: FilterSettings, known: VehicleRun) -> dict[str, Parts]:
    """Show an outage dragged along the drive, by the aids; return all errors by the aids."""
    by_aids = {aids: parts(outages(drive, told, known, aids), drive) for aids in AIDS}
    off = {aids: np.hypot(*(part[-1] for part in both)) for aids, both in by_aids.items()}
    origin, bends = drive.reference.position[0], turned(drive)
    road = ((drive.reference.position - origin) * metres(origin))[:, [1, 0]] / 1000
    order, t = STARTS.tolist(), np.arange(0, LENGTH + 1, 2)
    shown = Moving(
        "Forty seconds without satellites",
        Slider("k", "satellites lost at", order[::2], 220, "{:d} s", plays=True),
        Slider("a", "aids", [*AIDS], "constraint", "{}"),
    )
    middle, span = (road.max(axis=0) + road.min(axis=0)) / 2, np.ptp(road, axis=0) / 2 + 0.2
    span[0] = max(span[0], 1.7 * span[1])  # wider than high, or a phone has no room for it
    x, y = ((float(m - s), float(m + s)) for m, s in zip(middle, span, strict=True))
    axes = {"x": "east (km)", "y": "north (km)", "xlim": x, "ylim": y}
    drawn = shown.chart("The drive: drag the outage along it", equal=True, **axes)

    def lost(a: str) -> Array:
        """Return where outages, one after the other, end more than 20 m off."""
        every = range(0, len(STARTS), LENGTH // 10)
        rows = [road[STARTS[i] : STARTS[i] + LENGTH : 8] for i in every if off[a][i] > LOST]
        return np.concatenate([np.zeros((0, 2)), *rows]).T

    shown.draw(drawn, "truth", "", road[::6].T)
    shown.draw(drawn, "kalman", "", lost, style="points")
    shown.draw(drawn, "ins", "", lambda k: road[k : k + LENGTH + 1 : 4].T)
    shown.draw(drawn, "ins", "", lambda k: road[[k + LENGTH // 2]].T, style="handle")

    def curve(part: int, a: str, k: int) -> Any:
        return t, by_aids[a][part][t, order.index(k)]

    def ends(a: str, k: int) -> str:
        return ", ".join(f"{abs(part[-1, order.index(k)]):.0f} m" for part in by_aids[a])

    for part, chart in enumerate(_along_and_across(shown, 100)):
        shown.draw(chart, "ins", "INS alone", partial(curve, part, "none"))
        shown.draw(chart, "kalman", "aided", partial(curve, part))
    shown.number("computed", "INS alone: along, across", lambda k: ends("none", k))
    shown.number("computed", "aided: along, across", lambda k, a: ends(a, k))
    shown.sentence(lambda k, a: (
        f"Satellites lost at {k} s, on a road that turns by {bends[order.index(k)]:.0f}°. Errors "
        f"along and across it after {LENGTH} s: INS alone {ends('none', k)}; "
        f"with aids ({a}) {ends(a, k)}."
    ))  # fmt: skip
    shown.show(
        "fig-l6-drive",
        "Until the outage, both filters have satellites, compass and constraint. Dots on "
        f"the road: outages that end more than {LOST} m off with the chosen aids.",
    )
    return by_aids


def _along_and_across(shown: Moving, reach: float) -> list[Chart]:
    """Add a chart of errors along the road, and one of errors across it."""
    axes = {"x": "time without satellites (s)", "xlim": (0, LENGTH)}
    names = "Error along the road", "Error across the road"
    return [shown.chart(name, ylim=(-reach, reach), **axes) for name in names]


def show_wrong_start(navigate: Navigate) -> None:
    """Show how far off an INS is that begins tilted, with a wrong heading, or a gyro's bias."""
    right, t = navigate(np.zeros(3)), np.arange(LENGTH + 1.0)
    ahead = np.hypot(*(right - t[:, None] * right[1])[:, :2].T)  # of where it would go straight on
    fall = _GRAVITY * t**2 / 2
    # by what is wrong: the unit of its size, in degrees, degrees, and degrees an hour; the formula
    wrong = {
        "tilt": (0.02, "{:.2f}°", fall, "½ g θ t²"),
        "gyro bias": (3.0, "{:.0f}°/h", fall * t / 3 / 3600, "g b t³/6"),
        "heading": (0.5, "{:.1f}°", ahead, "δψ · distance from straight on"),
    }

    @cache
    def off(w: str, s: int) -> Array:
        size = np.radians(s * wrong[w][0])
        turn = {"tilt": [0, size, 0], "heading": [0, 0, size]}.get(w, [0, 0, 0])
        bias = [0, size / 3600 if w == "gyro bias" else 0, 0]
        return np.asarray(np.hypot(*(navigate(turn, bias) - right)[:, :2].T))

    def size(w: str, s: int) -> str:
        return wrong[w][1].format(s * wrong[w][0])

    shown = Moving(
        "What is wrong at the start",
        Slider("w", "wrong at the start", [*wrong], "tilt", "{}"),
        Slider("s", "size", [*range(6)], 5, "{:d} of 5"),
    )

    def formula(w: str, s: int) -> Parts:
        return t, np.radians(s * wrong[w][0]) * wrong[w][2]

    chart = shown.chart("Error of the INS", xlim=(0, LENGTH), ylim=(0, 25))
    shown.draw(chart, "ins", "INS", lambda w, s: (t, off(w, s)))
    shown.draw(chart, "published", "formula", formula)
    shown.number("computed", "wrong", lambda w, s: f"{w} {size(w, s)}")
    shown.number("published", "formula", lambda w: wrong[w][3])
    shown.number("ins", "after 40 s", lambda w, s: f"{off(w, s)[-1]:.1f} m")
    shown.sentence(
        lambda w, s: f"A {w} of {size(w, s)} makes an error of {off(w, s)[-1]:.1f} m in {LENGTH} s."
    )
    shown.show(
        "fig-l6-wrong",
        "The same samples, integrated from a correct start and from a wrong one. From "
        "about 10 s on, the car brakes and turns.",
    )


def show_constraint(constrain: Constrain) -> None:
    """Show the spread of the velocity after one look, a turn, and another look."""
    angles = [*range(0, 91, 3)]
    circle = np.eye(2)
    once = constrain(circle, 0.0)
    twice = {q: constrain(once, np.radians(q)) for q in angles}
    shown = Moving(
        "What the constraint reveals", Slider("q", "the car turns by", angles, 0, "{:d}°")
    )
    axes = {"x": "east (m/s)", "y": "north (m/s)", "xlim": (-2.3, 2.3), "ylim": (-1.15, 1.15)}
    chart = shown.chart("Spread of the velocity error", equal=True, **axes)
    shown.draw(chart, "ins", "before", ellipse(circle, 1), at=36)
    shown.draw(chart, "constant", "one update", ellipse(once, 1), at=1)
    shown.draw(chart, "kalman", "two updates", lambda q: ellipse(twice[q], 1), at=68)

    def size(P: Array) -> float:
        return float(np.sqrt(np.linalg.eigvalsh(P)[-1]))

    shown.number("constant", "one update, longest axis", f"{size(once):.2f} m/s")
    shown.number("kalman", "two updates, longest axis", lambda q: f"{size(twice[q]):.2f} m/s")
    shown.sentence(lambda q: (
        f"After one update, the velocity is uncertain by {size(once):.2f} m/s along the road; "
        f"after a turn by {q} degrees and a second update, by {size(twice[q]):.2f} m/s at most."
    ))  # fmt: skip
    shown.goal("half of the error is gone", lambda q: size(twice[q]) < 0.5)
    shown.show(
        "fig-l6-constraint",
        "One standard deviation of the velocity error. The car drives north and uses the "
        "constraint, then turns and uses it again.",
    )


def show_bands(drive: Drive, known: VehicleRun, outage: Outage, starts: Mapping[str, int]) -> None:
    """Show errors along and across inside the bands of the filter by hand, by place and aids."""
    t, true = np.arange(LENGTH + 1.0), drive.reference
    assert true.attitude is not None
    found = {}
    for place, k in starts.items():
        here, origin = slice(k, k + LENGTH + 1), known.position[k, :, 0]
        path = (true.position[here] - origin)[:, [1, 0]] * metres(origin)[[1, 0]]
        heading = yaw(true.attitude[here])
        axes = np.stack([along_across(unit, heading) for unit in np.eye(2)], axis=2)
        for aids in ("none", "constraint", "both"):
            p, P = outage(k, AIDS[aids])
            error = along_across(p[:, :2] - path, heading)
            band = np.sqrt(np.einsum("fti,tij,ftj->ft", axes, P[:, :2, :2], axes))
            found[place, aids] = np.array(error), 2 * band
    shown = Moving(
        "The filter by hand, and how certain it is",
        Slider("place", "road", [*starts], next(iter(starts)), "{}"),
        Slider("a", "aids", ["none", "constraint", "both"], "none", "{}"),
    )

    def sides(part: int, place: str, a: str) -> tuple[Array, Array, Array]:
        side = found[place, a][1][part]
        return t, -side, side

    def curve(part: int, place: str, a: str) -> Parts:
        return t, found[place, a][0][part]

    def ends(place: str, a: str) -> str:
        return ", ".join(f"± {side[-1]:.0f} m" for side in found[place, a][1])

    for part, chart in enumerate(_along_and_across(shown, 80)):
        shown.draw(chart, "kalman", "", partial(sides, part), style="band")
        shown.draw(chart, "kalman", "error", partial(curve, part))
    shown.number("computed", "band: along, across", ends)
    shown.sentence(lambda place, a: (
        f"Road: {place}; aids: {a}. After {LENGTH} s, the bands along the road and across it are "
        f"{ends(place, a)}."
    ))  # fmt: skip
    shown.show(
        "fig-l6-bands",
        "The band is two standard deviations to either side, according to the filter "
        "above, which sees neither satellites nor the truth.",
    )


def show_turns(drive: Drive, by_aids: Mapping[str, Parts]) -> None:
    """Show the error of all outages over how far the road turns in them."""
    bends = turned(drive)
    off = {aids: np.hypot(*(part[-1] for part in both)) for aids, both in by_aids.items()}
    shown = Moving("Where the car gets lost", Slider("a", "aids", [*AIDS], "none", "{}"))
    axes = {"x": "the road turns by (degrees)", "xlim": (0, 180), "ylim": (0, 120)}
    spread = shown.chart("All outages, after 40 s", **axes)
    shown.draw(spread, "kalman", "", lambda a: (np.minimum(bends, 180), off[a]), style="points")
    shown.draw(spread, "truth", f"{LOST} m", ([0, 180], [LOST, LOST]))

    def lost(a: str) -> str:
        far = off[a] > LOST
        straight, other = far[bends < STRAIGHT].mean(), far[bends >= STRAIGHT].mean()
        return f"{straight:.0%} on straight roads, {other:.0%} on others"

    shown.number("computed", f"lost: above {LOST} m", lost)
    shown.sentence(lambda a: f"With aids ({a}), above {LOST} m after 40 s: {lost(a)}.")
    shown.show(
        "fig-l6-turns",
        "Each dot is an outage. A road is called straight if the heading stays within "
        f"{STRAIGHT}°.",
    )


def show_learning(drive: Drive, trials: OutageTrials) -> Array:
    """Show what a machine learned in the last window, what it said, and what came.

    Returns how far the car was off in the last window of played outages, RMS, m, by outage.
    """
    starts, window = [int(k) for k in trials.starts], 40
    t, pairs = np.arange(LENGTH + 1), trials.ramps["lssvm"]
    east = metres(drive.reference.position[0])[1]
    learned, true, said, played = {}, {}, {}, []
    for i, k in enumerate(starts):
        use = (pairs.epoch > k - window) & (pairs.epoch <= k)
        learned[k] = pairs.epoch[use] - k, pairs.difference[use, 0]
        played.append(rms(np.hypot(*pairs.difference[use].T)))
        here = drive.reference.position[k : k + LENGTH + 1, 1]
        true[k] = (trials.positions["through"][: LENGTH + 1, 1, i, 0] - here) * east
        said[k] = trials.bridges["lssvm"].predicted[: LENGTH + 1, 0, i]
    shown = Moving("What the last outage teaches", Slider("k", "lost at", starts, 220, "{:d} s"))
    axes = {"x": "time (s); satellites are lost at 0", "xlim": (-window, LENGTH), "ylim": (-60, 60)}
    errors = shown.chart("Error of the aided car, east", **axes)
    shown.draw(errors, "network", "rehearsed", lambda k: learned[k], style="points", at=0)
    shown.draw(errors, "kalman", "true", lambda k: (t, true[k]))
    shown.draw(errors, "lssvm", "predicted", lambda k: (t, said[k]))

    def off(m: str, k: int) -> str:
        return f"{rms(trials.errors[m][1 : LENGTH + 1, starts.index(k)]):.1f} m"

    shown.number("computed", "aided: RMS", lambda k: off("through", k))
    shown.number("computed", "aided, learned: RMS", lambda k: off("lssvm", k))
    shown.sentence(lambda k: (
        f"Satellites lost at {k} s: the root mean square error over 40 s is {off('through', k)} "
        f"for the aided car, and {off('lssvm', k)} with the prediction."
    ))  # fmt: skip
    shown.show(
        "fig-l6-learning",
        "Dots: the error in outages that were rehearsed while there were satellites. The "
        "machine predicts the next outage from them.",
    )
    return np.array(played)


def show_recorded(trials: RecordedTrials) -> dict[str, Parts]:
    """Show the outages of the recorded drive, along and across, by what the project keeps.

    Returns the errors of each method at the end of each outage, along and across, m.
    """
    starts, t = [int(k) for k in trials.starts], np.arange(0, 51)
    labels = {"ins": "INS alone", "kalman": "aided", "lssvm": "aided, learned"}
    methods = dict(zip(("never", "through", "lssvm"), labels, strict=True))
    found = {}
    for i, k in enumerate(starts):
        path = trials.reference[k : k + 51]
        step = np.gradient(path, axis=0)
        moving = np.hypot(*step.T) > 1
        heading = np.arctan2(step[:, 0], step[:, 1])
        held = np.maximum.accumulate(np.where(moving, t, 0))  # as the compass holds it
        for name, m in methods.items():
            error = trials.tracks[name][:, :, i] - path
            found[m, k] = np.array(along_across(error, heading[held]))[:, : LENGTH + 1]
    shown = Moving("A recorded drive", Slider("k", "satellites lost at", starts, 120, "{:d} s"))
    along, across = _along_and_across(shown, 60)
    shown.draw_each(along, labels, lambda m, k: (t[: LENGTH + 1], found[m, k][0]))
    shown.draw_each(across, labels, lambda m, k: (t[: LENGTH + 1], found[m, k][1]))
    said = shown.number_each(labels, lambda m, k: f"{rms(np.hypot(*found[m, k])[1:]):.1f} m")
    shown.sentence(lambda k: f"Satellites lost at {k} s; RMS errors over 40 s: {said(k)}.")
    shown.show(
        "fig-l6-recorded",
        "The accelerometer and gyro data are recorded, and so is the path; fixes and "
        "compass readings are made from the path by adding noise.",
    )
    ends = {n: np.array([found[m, k][:, LENGTH] for k in starts]).T for n, m in methods.items()}
    return {name: (along, across) for name, (along, across) in ends.items()}


def _numbers(
    straight: NDArray[np.bool_], ends: Mapping[str, Parts], navigate: Navigate,
    in_town: Mapping[str, Parts],
) -> Said:  # fmt: skip
    """Return what the text says of both drives."""
    found: Said = {
        f"recorded.{name}.{where}": (rms(part), "m", "RMS after 40 s, twelve outages.")
        for name, what in (("ins", "never"), ("aided", "through"))
        for part, where in zip(in_town[what], ("along", "across"), strict=True)
    }
    every = slice(None)
    for name, at, which in (("along", 0, every), ("across", 1, every), ("straight", 0, straight)):
        ratio = rms(ends["constraint"][at][which]) / rms(ends["none"][at][which])
        how = "Share that the constraint takes, RMS after 40 s, all outages."
        found[f"taken.{name}"] = 100 * (1 - ratio), "%", how
    far = np.hypot(*ends["constraint"]) > LOST
    for name, which in (("straight", straight), ("other", ~straight)):
        how = "Outages that end more than 20 m off with the constraint."
        found[f"lost.{name}"] = float(100 * far[which].mean()), "%", how
    found["alone.across"] = rms(ends["constraint"][1]), "m", "RMS after 40 s, constraint alone."
    right = navigate(np.zeros(3))
    none, y, z = np.radians([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    starts = {"tilted": (0.05 * y,), "headed": (2 * z,), "biased": (none, y / 360)}  # 10 deg/h
    for name, wrong in starts.items():
        off = float(np.hypot(*(navigate(*wrong) - right)[LENGTH, :2]))
        found[name] = off, "m", "Of the INS at 153 s, begun so at 113 s."
    without = float(_GRAVITY * np.radians(0.1) * LENGTH**2 / 2)
    found["free.without"] = without, "m", "The formula g tilt t^2 / 2."
    found["free.with"] = float(14 * np.radians(0.5) * LENGTH), "m", "The formula v psi t."
    turn = np.arcsin((0.06 / 1.03) ** 0.5)  # three times 1 / P, with R = 0.01
    found["halves"] = float(np.degrees(turn)), "deg", "Turn that halves the velocity error along."
    found["earth"] = float(np.degrees(7.292e-5 * LENGTH)), "deg", "The turn of the earth in 40 s."
    return found


#: What P3 prints of its outages: where it stands among its numbers, its words, and its name in the
#: evidence
_PRINTED = {
    "outage1.kf_max": ("outage 1, KF, largest, m", "40.never.place1.max"),
    "outage1.proposed_max": ("outage 1, proposed, largest, m", "40.lssvm.place1.max"),
    "outage1.improvement_max": ("outage 1, reduction of the largest, %", "40.gain.place1.max"),
    "outage4.kf_max": ("outage 4, KF, largest, m", "40.never.place4.max"),
    "outage4.proposed_max": ("outage 4, proposed, largest, m", "40.lssvm.place4.max"),
    "outage4.difference_about": ("outage 4, proposed less KF, m", "40.difference.place4.max"),
    "outage4.improvement_rms": ("outage 4, reduction of the RMS, %", "40.gain.place4.rms"),
    "outage5.improvement_about": ("outage 5, reduction of the RMS, %", "40.gain.place5.rms"),
    "outage5.improvement_about.": ("outage 5, reduction of the largest, %", "40.gain.place5.max"),
    "outage8.improvement_about": ("outage 8, reduction of the largest, %", "40.gain.place8.max"),
    "outage5_50s.kf_max": ("outage 5, 50 s, KF, largest, m", "50.never.place5.max"),
    "outage5_50s.rbf_max": ("outage 5, 50 s, RBF, largest, m", "50.rbf.place5.max"),
    "outage5_50s.proposed_max": ("outage 5, 50 s, proposed, largest, m", "50.lssvm.place5.max"),
    **{
        f"outage5_50s.improvement_vs_{name}": (
            f"outage 5, 50 s, reduction against {name.upper()}, %", f"50.gain.place5.over-{name}",
        )
        for name in ("rbf", "kf")
    },
    **{
        f"ranges.{method}_{kind}.{end}": (
            f"{word} {words} of all outages, {label}, m", f"40.{name}.{kind}.{which}",
        )
        for method, label, name in (("kf", "KF", "never"), ("proposed", "proposed", "lssvm"))
        for kind, words in (("rms", "RMS"), ("max", "maximum"))
        for end, word, which in ((0, "least", "least"), (1, "largest", "most"))
    },
    "average_improvement_at_least": ("other seven, reduction of the RMS, %", "40.gain.seven.rms"),
    "average_improvement_at_least.": (
        "other seven, reduction of the largest, %", "40.gain.seven.max",
    ),
}  # fmt: skip


def show_outages(
    record: book.ChapterRecord, printed: Any, many: VehicleOutages, recorded: RecordedTrials
) -> None:
    """Show what P3 prints of its outages beside what simulated drives and a recorded one give."""
    # what shows tables is not there in the page
    from inswsn_book.lessons.printed import Cell, show_printed  # noqa: PLC0415

    def said(path: str) -> str:
        found = printed
        for key in filter(None, path.split(".")):
            found = found[int(key) if key.isdigit() else key]
        about = "about " * ("about" in path) + "more than " * ("at_least" in path)
        return f"{about}{found}"

    def cell(path: str, label: str, name: str) -> Cell:
        equal = "the same"
        if ".never." in name:
            equal = "sim." + name.replace("never", "through")
        elif re.search(r"\.(gain|difference)\.", name) and "rbf" not in name:
            equal = f"fair.cells.{name}"
        other = re.sub(r"\.place\d", "", name).replace("seven", "all")
        return Cell(label, said(path), f"sim.{name}", equal, f"recorded.cells.{other}")

    methods = "never", "through", "lssvm", "rbf"
    show_printed(
        record, "p3-vehicle",
        [cell(path, *words) for path, words in _PRINTED.items()],
        lambda: rebuild_outages(many.errors_of(methods)) | rebuild_recorded(recorded),
        by=("seed", "lateral", "slip", "compass_bias", "tau", "window"),
        name="tbl-l6-p3",
        caption="Errors in P3's outages, and by how much the proposed method reduces those of KF; "
        "40 s without GPS if not said otherwise; medians and 95 % of drives. Rebuilt: on simulated "
        "roads of the same kinds; KF has no aids, the proposed method has both and the machine. On "
        "equal terms: KF has the same aids. Recorded: the recorded drive, on other roads; medians "
        f"and 95 % of its {len(recorded.starts)} outages, or of draws where the outages are taken "
        "together. It does not follow the parameters.",
    )  # fmt: skip


def read_p3(parameters: dict[str, float]) -> tuple[book.ChapterRecord, RecordedTrials, Any]:
    """Return the record of the lesson, what is kept of the recorded drive, and P3's numbers."""
    record = book.ChapterRecord("lesson-6", {**parameters})
    record.data("scenarios/p3.yaml")
    trials, _ = read_trials(record.data("recorded/p3-drive.json"))
    return record, trials, read_numbers(record.data("papers/p3.yaml"))


def hold(
    record: book.ChapterRecord, drive: Drive, by_aids: Mapping[str, Parts], navigate: Navigate,
    outage: Outage, factor: Callable[..., float], size: Mapping[str, Array], played: Array,
    in_town: Mapping[str, Parts],
) -> None:  # fmt: skip
    """Note the numbers of the text, hold its sentences against them, and write the record."""
    named = "factor.through-never", "methods.lssvm"
    for name in (*named, "recorded.factor.through-never", "recorded.factor.lssvm"):
        record.quote("p3-vehicle", name, ".2f")
    for said_as, name in (
        ("proven", "proven.none"), ("constraint", "ladder.share.constraint-of-aids"),
        ("recorded.constraint", "recorded.ladder.share.constraint-of-aids"),
    ):  # fmt: skip
        record.quote("p3-vehicle", name, short=said_as, unit=0.01)
    straight = turned(drive) < STRAIGHT
    ends = {aids: (along[-1], across[-1]) for aids, (along, across) in by_aids.items()}
    said = _numbers(straight, ends, navigate, in_town)
    basis = {"recorded": "emulation", "free": "algebra"}
    for name, (value, unit, how) in said.items():
        record.note(name, value, unit, how, basis=basis.get(name.partition(".")[0], "simulation"))
    share, learned = played / size["through"][:, 0], {}
    for name, which in (("", share > 0), (".large", share > 2), (".small", share < 1)):
        learned[name] = factor("lssvm", "through", which)
        how = "RMS over that of the aided car, by how far off the played outages were."
        record.note(f"learned{name}", learned[name], "1", how, relative=1e-2)  # as in the evidence
    off = {aids: np.hypot(*both) for aids, both in ends.items()}
    lost = off["constraint"] > LOST
    spread = np.trace(outage(113, ["constraint"])[1][:, :2, :2], axis1=1, axis2=2) ** 0.5
    alone, aided = (rms(np.hypot(*in_town[name])) for name in ("never", "through"))
    for sentence, holds in {
        "The compass alone takes nothing.": abs(rms(off["compass"]) / rms(off["none"]) - 1) < 0.05,
        "The constraint takes most of the error across.": said["taken.across"][0] > 75,
        "On straight roads it takes nothing along.": abs(said["taken.straight"][0]) < 10,
        "The lost are on straight roads.": lost[straight].mean() > 3 * lost[~straight].mean(),
        "In the turn the band closes.": spread[25:30].min() < 0.7 * spread[20],
        "Learning does harm.": learned[""] > 1,
        "Most where the played outages were larger.": learned[".large"] > 2 * learned[".small"],
        "More often than not.": np.mean(size["lssvm"] > size["through"]) > 0.5,
        "Recorded, aids take most of the error.": aided < alone / 4,
    }.items():
        record.holds(sentence, holds)
    record.write()
