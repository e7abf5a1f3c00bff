"""The pictures of the lesson on a car that does not slide."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from inswsn_book.moving import Moving, Slider
from inswsn_lib.navigation import OutageTrials, RecordedTrials
from inswsn_lib.vehicle import (
    Drive,
    FilterSettings,
    VehicleRun,
    VehicleState,
    metres,
    position_error,
    replay,
    run_vehicle_filter,
    yaw,
)

Array = NDArray[np.float64]
Integers = NDArray[np.intp]
#: Positions (m), velocities (m/s) and attitudes after each sample, of a start turned by an angle
Navigate = Callable[[Array], Array]
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


def aided(drive: Drive, told: FilterSettings, aids: str) -> tuple[Drive, FilterSettings]:
    """Return drive and settings of a filter that has these aids, if any, and no others."""
    deaf = np.full_like(drive.compass, np.nan)
    deaf[0] = drive.compass[0]  # from which every run begins
    return (
        drive if "compass" in AIDS[aids] else replace(drive, compass=deaf),
        told if "constraint" in AIDS[aids] else replace(told, lateral=1e6),
    )


def outages(drive: Drive, told: FilterSettings, aids: str) -> VehicleRun:
    """Return the library's filter with some aids through an outage from each of `STARTS` on."""
    there, believed = aided(drive, told, aids)
    with_gps = run_vehicle_filter(there, believed, last=int(STARTS[-1]))
    return replay(there, believed, with_gps, STARTS, LENGTH, aiding=True)


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


def show_drive(drive: Drive, told: FilterSettings) -> dict[str, tuple[Array, Array]]:
    """Show an outage dragged along the drive, by the aids; return all errors by the aids."""
    by_aids = {aids: parts(outages(drive, told, aids), drive) for aids in AIDS}
    bends = turned(drive)
    starts = [int(k) for k in STARTS[::2]]
    shown = Moving(
        "Forty seconds without satellites",
        Slider("k", "they are lost at", starts, 220, "{:d} s"),
        Slider("a", "aids", [*AIDS], "compass", "{}"),
    )
    t = np.arange(0, LENGTH + 1, 2)

    def at(a: str, k: int, part: int) -> Array:
        return np.asarray(by_aids[a][part][:, 2 * starts.index(k)])

    def draw(part: int, where: str) -> None:
        chart = shown.chart(
            f"Error {where}", x="time without satellites (s)", y="error (m)", xlim=(0, LENGTH),
            ylim=(-100, 100),
        )  # fmt: skip
        shown.draw(chart, "ins", "INS alone", lambda k: (t, at("none", k, part)[t]))
        shown.draw(chart, "kalman", "aided", lambda k, a: (t, at(a, k, part)[t]))

    def ends(a: str, k: int) -> str:
        return ", ".join(f"{abs(at(a, k, part)[-1]):.0f} m" for part in (0, 1))

    draw(0, "along the road")
    draw(1, "across it")
    shown.number("truth", "the road turns by", lambda k: f"{bends[2 * starts.index(k)]:.0f}°")
    shown.number("ins", "INS along, across", lambda k: ends("none", k))
    shown.number("kalman", "aided", lambda k, a: ends(a, k))
    shown.sentence(
        lambda k, a: (
            f"Lost at {k} s, on a road that turns by {bends[2 * starts.index(k)]:.0f} degrees: "
            f"after {LENGTH} s the INS alone is off by {abs(at('none', k, 0)[-1]):.0f} m along and "
            f"{abs(at('none', k, 1)[-1]):.0f} m across; with aids ({a}) by "
            f"{abs(at(a, k, 0)[-1]):.0f} m and {abs(at(a, k, 1)[-1]):.0f} m."
        )
    )
    shown.show(
        name="fig-l6-drive",
        caption="Both filters had satellites and their own aids until the outage. Move it "
        "along the drive and change the aids.",
        alt=f"Two charts over 40 s. Lost at 220 s the INS alone is off by "
        f"{abs(at('none', 220, 0)[-1]):.0f} m along the road and "
        f"{abs(at('none', 220, 1)[-1]):.0f} m across it at the end; with a compass by "
        f"{abs(at('compass', 220, 0)[-1]):.0f} m and {abs(at('compass', 220, 1)[-1]):.0f} m.",
    )
    return by_aids


#: Errors of an outage by aids, start, and part: along or across


def show_wrong_start(navigate: Navigate) -> None:
    """Show how far off an INS is that begins tilted, or with a wrong heading."""
    tilts, headings = ([round(i * step, 2) for i in range(6)] for step in (0.1, 1.0))
    right = navigate(np.zeros(3))
    t = np.linspace(0, LENGTH, 41)
    every = (len(right) - 1) // (len(t) - 1)

    def off(turn: Sequence[float]) -> Array:
        return np.asarray(np.hypot(*(navigate(np.radians(turn)) - right)[::every, :2].T))

    by_tilt = {s: off([0.0, s, 0.0]) for s in tilts}
    by_heading = {h: off([0.0, 0.0, h]) for h in headings}
    shown = Moving(
        "A tilt and a wrong heading",
        Slider("s", "tilt", tilts, 0.1, "{:.1f}°"),
        Slider("h", "heading wrong by", headings, 2.0, "{:.0f}°"),
    )
    time = {"x": "time (s)", "y": "off by (m)", "xlim": (0, LENGTH), "ylim": (0, 80)}
    tilted = shown.chart("A tilt: gravity gets in", **time)
    shown.draw(tilted, "ins", "INS", lambda s: (t, by_tilt[s]), at=34)
    shown.draw(
        tilted,
        "published",
        "½ g · tilt · t²",
        lambda s: (t, 9.79 * np.radians(s) * t**2 / 2),
        at=22,
    )
    turned_off = shown.chart("A wrong heading waits for a turn", **time)
    shown.draw(turned_off, "ins", "INS", lambda h: (t, by_heading[h]), at=34)
    shown.number("ins", "tilt, after 40 s", lambda s: f"{by_tilt[s][-1]:.1f} m")
    shown.number("ins", "heading, after 40 s", lambda h: f"{by_heading[h][-1]:.1f} m")
    shown.sentence(
        lambda s, h: (
            f"After 40 s a tilt of {s:.1f} degrees has led the INS {by_tilt[s][-1]:.1f} m away, a "
            f"heading that is wrong by {h:.0f} degrees {by_heading[h][-1]:.1f} m."
        )
    )
    shown.show(
        name="fig-l6-wrong",
        caption="The same sensors, integrated from a right start and from a wrong one. The dashed "
        "line is the formula.",
        alt=f"Two charts over 40 s. A tilt of 0.1 degrees leads {by_tilt[0.1][-1]:.1f} m away, "
        f"as the formula has it. A heading wrong by 2 degrees leads {by_heading[2.0][-1]:.1f} m "
        "away, nothing before the car brakes and turns.",
    )


def _ellipse(P: Array) -> tuple[Array, Array]:
    turn = np.linspace(0, 2 * np.pi, 61)
    x, y = np.linalg.cholesky(P) @ np.stack([np.cos(turn), np.sin(turn)])
    return x, y


def show_constraint(constrain: Constrain) -> None:
    """Show the spread of the velocity after one look, a turn, and another look."""
    angles = [*range(0, 91, 3)]
    circle = np.eye(2)
    once = constrain(circle, 0.0)
    twice = {q: constrain(once, np.radians(q)) for q in angles}
    shown = Moving(
        "What a look sideways tells", Slider("q", "the car turns by", angles, 0, "{:d}°")
    )
    chart = shown.chart(
        "Spread of the velocity error", x="east (m/s)", y="north (m/s)", xlim=(-2.3, 2.3),
        ylim=(-1.15, 1.15), equal=True,
    )  # fmt: skip
    shown.draw(chart, "ins", "before", _ellipse(circle), at=20)
    shown.draw(chart, "constant", "one look, going north", _ellipse(once), at=15)
    shown.draw(chart, "kalman", "after the turn", lambda q: _ellipse(twice[q]), at=50)

    def size(P: Array) -> float:
        return float(np.sqrt(np.linalg.eigvalsh(P)[-1]))

    shown.number("constant", "one look, longest", f"{size(once):.2f} m/s")
    shown.number("kalman", "two looks, longest", lambda q: f"{size(twice[q]):.2f} m/s")
    shown.sentence(
        lambda q: (
            f"After one look the velocity is unsure by {size(once):.2f} m/s along the road. After "
            f"a turn by {q} degrees and another look by {size(twice[q]):.2f} m/s at most."
        )
    )
    shown.show(
        name="fig-l6-constraint",
        caption="One standard deviation of the velocity error. The car goes north and looks "
        "sideways, then turns and looks again.",
        alt=f"A circle of 1 m/s, and an ellipse that is {size(once):.2f} m/s long to the north and "
        f"0.1 m/s wide. A second look after no turn changes little; after 30 degrees at most "
        f"{size(twice[30]):.2f} m/s remain in any direction.",
    )


def show_bands(drive: Drive, known: VehicleRun, outage: Outage, starts: Mapping[str, int]) -> None:
    """Show errors along and across inside the bands of the filter by hand, by place and aids."""
    t, true = np.arange(LENGTH + 1), drive.reference
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
        "The filter by hand, and how sure it is",
        Slider("place", "road", [*starts], next(iter(starts)), "{}"),
        Slider("a", "aids", ["none", "constraint", "both"], "none", "{}"),
    )

    def draw(part: int, where: str) -> None:
        chart = shown.chart(
            f"Error {where}", x="time without satellites (s)", y="error (m)", xlim=(0, LENGTH),
            ylim=(-80, 80),
        )  # fmt: skip

        def band(place: str, a: str) -> tuple[Integers, Array, Array]:
            side = found[place, a][1][part]
            return t, -side, side

        shown.draw(chart, "kalman", "", band, style="band")
        shown.draw(chart, "kalman", "error", lambda place, a: (t, found[place, a][0][part]))
        shown.number(
            "kalman",
            f"sure to, {where}",
            lambda place, a: f"± {found[place, a][1][part, -1]:.1f} m",
        )

    draw(0, "along the road")
    draw(1, "across it")
    shown.sentence(
        lambda place, a: (
            f"Road: {place}; aids: {a}. After {LENGTH} s the band is "
            f"{found[place, a][1][0, -1]:.0f} m to either side along the road, and "
            f"{found[place, a][1][1, -1]:.0f} m across it."
        )
    )
    first = next(iter(starts))
    shown.show(
        name="fig-l6-bands",
        caption="The band is two standard deviations to either side, by the filter above. It looks "
        "neither at satellites nor at the truth.",
        alt=f"Two charts over 40 s. On the first road ({first}) without aids both bands open to "
        f"{found[first, 'none'][1][0, -1]:.0f} m; with the constraint that along the road to "
        f"{found[first, 'constraint'][1][0, -1]:.0f} m, that across to "
        f"{found[first, 'constraint'][1][1, -1]:.0f} m.",
    )


def show_turns(drive: Drive, by_aids: Mapping[str, tuple[Array, Array]]) -> None:
    """Show where on the map an error remains, and the error over how far the road turns."""
    bends = turned(drive)
    off = {aids: np.hypot(*(part[-1] for part in both)) for aids, both in by_aids.items()}
    origin = drive.reference.position[0]
    road = ((drive.reference.position - origin) * metres(origin))[:, [1, 0]] / 1000
    limits = [*range(5, 61, 5)]
    shown = Moving(
        "Where is the car lost?",
        Slider("m", "off by more than", limits, 20, "{:d} m"),
        Slider("a", "aids", [*AIDS], "none", "{}"),
    )
    middle, span = (road.max(axis=0) + road.min(axis=0)) / 2, np.ptp(road, axis=0) / 2 + 0.2
    span[0] = max(span[0], 1.7 * span[1])  # wider than high, or a phone has no room for it
    x, y = ((float(m - s), float(m + s)) for m, s in zip(middle, span, strict=True))
    drawn = shown.chart(
        "The drive", x="east (km)", y="north (km)", xlim=x, ylim=y, equal=True,
    )  # fmt: skip
    pieces = [*range(0, len(STARTS), LENGTH // 10)]  # one after the other

    def lost(m: int, a: str) -> tuple[Array, Array]:
        rows = [road[STARTS[i] : STARTS[i] + LENGTH : 8] for i in pieces if off[a][i] > m]
        here = np.concatenate(rows) if rows else np.zeros((0, 2))
        return here[:, 0], here[:, 1]

    shown.draw(drawn, "truth", "", road[::6].T)
    shown.draw(drawn, "kalman", "", lost, style="points")
    spread = shown.chart(
        "All outages, after 40 s", x="the road turns by (degrees)", y="off by (m)", xlim=(0, 180),
        ylim=(0, 120),
    )  # fmt: skip
    shown.draw(spread, "kalman", "", lambda a: (np.minimum(bends, 180), off[a]), style="points")
    shown.draw(spread, "truth", "", lambda m: ([0, 180], [m, m]))
    straight = bends < 15

    def share(m: int, a: str, which: NDArray[np.bool_]) -> str:
        return f"{np.mean(off[a][which] > m):.0%}"

    shown.number("kalman", "lost on straight roads", lambda m, a: share(m, a, straight))
    shown.number("kalman", "lost on others", lambda m, a: share(m, a, ~straight))
    shown.sentence(
        lambda m, a: (
            f"With aids ({a}) the car is off by more than {m} m after 40 s in "
            f"{share(m, a, straight)} of the outages on straight roads and in "
            f"{share(m, a, ~straight)} of the others."
        )
    )
    shown.show(
        name="fig-l6-turns",
        caption="Dots on the road: outages after which the car is off by more than that. Below, "
        "every outage. A road is called straight if the heading stays within 15°.",
        alt=f"A map of the drive, and the error over how far the road turns. Without aids "
        f"{share(20, 'none', straight)} of the outages on straight roads end more than 20 m off, "
        f"and {share(20, 'none', ~straight)} of the others; with both aids "
        f"{share(20, 'both', straight)} and {share(20, 'both', ~straight)}.",
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
    axes = {"x": "time (s); satellites are lost at 0", "xlim": (-window, LENGTH)}
    errors = shown.chart("Error of the aided car, east", y="error (m)", ylim=(-60, 60), **axes)
    shown.draw(errors, "network", "", lambda k: learned[k], style="points")
    shown.draw(errors, "kalman", "true", lambda k: (t, true[k]))
    shown.draw(errors, "lssvm", "foretold", lambda k: (t, said[k]))
    distance = shown.chart("Distance from the true position", y="off by (m)", ylim=(0, 80), **axes)
    off = {
        m: dict(zip(starts, trials.errors[m][: LENGTH + 1, :, 0].T, strict=True))
        for m in trials.errors
    }
    shown.draw(distance, "kalman", "aided", lambda k: (t, off["through"][k]))
    shown.draw(distance, "lssvm", "and learned", lambda k: (t, off["lssvm"][k]))
    shown.number("network", "played outages", "dots")
    shown.number("kalman", "aided", lambda k: f"{rms(off['through'][k][1:]):.1f} m")
    shown.number("lssvm", "aided and learned", lambda k: f"{rms(off['lssvm'][k][1:]):.1f} m")
    shown.sentence(
        lambda k: (
            f"Lost at {k} s: the aided car is off by {rms(off['through'][k][1:]):.1f} m (root mean "
            f"square over 40 s), with what was learned by {rms(off['lssvm'][k][1:]):.1f} m."
        )
    )
    k = 220
    shown.show(
        name="fig-l6-learning",
        caption="Dots: by how much the car was off in outages that were only played, while "
        "satellites were there. The machine takes them for the next outage.",
        alt=f"Two charts. Lost at {k} s the aided car is off by "
        f"{rms(off['through'][k][1:]):.1f} m; with what the machine foretells by "
        f"{rms(off['lssvm'][k][1:]):.1f} m.",
    )
    return np.array(played)


def show_recorded(trials: RecordedTrials) -> tuple[dict[str, tuple[Array, Array]], float]:
    """Show the outages of the recorded drive, along and across, by what the project keeps.

    Returns the errors of each method at the end of each outage, along and across, m, and the least
    range of the heading in an outage, degrees.
    """
    starts, t = [int(k) for k in trials.starts], np.arange(0, 51)
    methods = {
        "never": ("ins", "INS alone"),
        "through": ("kalman", "aided"),
        "lssvm": ("lssvm", "learned"),
    }
    found, bends = {}, []
    for i, k in enumerate(starts):
        path = trials.reference[k : k + 51]
        step = np.gradient(path, axis=0)
        moving = np.hypot(*step.T) > 1
        heading = np.arctan2(step[:, 0], step[:, 1])
        held = np.maximum.accumulate(np.where(moving, t, 0))  # as the compass holds it
        bends.append(np.degrees(np.ptp(np.unwrap(heading[held][: LENGTH + 1]))))
        for m in methods:
            found[m, k] = along_across(trials.tracks[m][:, :, i] - path, heading[held])
    shown = Moving("A recorded drive", Slider("k", "satellites are lost at", starts, 120, "{:d} s"))
    off = {(m, k): rms(np.hypot(*found[m, k])[1:41]) for m, k in found}
    charts = [
        shown.chart(
            f"Error {where}", x="time without satellites (s)", y="error (m)", xlim=(0, LENGTH),
            ylim=(-60, 60),
        )
        for where in ("along the road", "across it")
    ]  # fmt: skip

    def draw(m: str, stroke: str, label: str) -> None:
        shown.draw(charts[0], stroke, label, lambda k: (t[:41], found[m, k][0][:41]))
        shown.draw(charts[1], stroke, label, lambda k: (t[:41], found[m, k][1][:41]))
        shown.number(stroke, label, lambda k: f"{off[m, k]:.1f} m")

    for m, (stroke, label) in methods.items():
        draw(m, stroke, label)
    shown.sentence(
        lambda k: (
            f"Lost at {k} s the INS alone is off by {off['never', k]:.1f} m (root mean square over "
            f"40 s), the aided one by {off['through', k]:.1f} m, and with what was learned by "
            f"{off['lssvm', k]:.1f} m."
        )
    )
    shown.show(
        name="fig-l6-recorded",
        caption="The accelerometers and gyros are recorded, and so is the road; the fixes and the "
        "compass are made from the road by adding noise.",
        alt=f"Two charts over 40 s of a recorded drive. Lost at 120 s the INS alone is off by "
        f"{off['never', 120]:.1f} m, the aided one by {off['through', 120]:.1f} m, with what was "
        f"learned by {off['lssvm', 120]:.1f} m.",
    )
    ends = {m: np.array([[part[LENGTH] for part in found[m, k]] for k in starts]) for m in methods}
    return {m: (ends[m][:, 0], ends[m][:, 1]) for m in methods}, float(min(bends))


#: A number of the text: its value, its unit, and how it is made
Said = dict[str, tuple[float, str, str]]


def _alike(run: VehicleRun, k: int) -> float:
    """Return the correlation of the errors of tilt and bias, as accelerations along the car."""
    _, C, _, P = in_metres(run.states[k, 0])
    tilt, bias = np.zeros((2, 15))
    tilt[6:9], bias[9:12] = np.cross(C[:, 0], [0, 0, _GRAVITY]), C[:, 0] @ C
    return float(tilt @ P @ bias / np.sqrt(tilt @ P @ tilt * (bias @ P @ bias)))


def numbers(
    drive: Drive,
    by_aids: Mapping[str, tuple[Array, Array]],
    navigate: Navigate,
    plain: VehicleRun,
    constrain: Constrain,
) -> Said:
    """Return what the text says of the simulated drive.

    The filter `plain` has GPS alone, until 113 s.
    """
    straight = turned(drive) < 15
    ends = {aids: [part[-1] for part in both] for aids, both in by_aids.items()}
    found: Said = {}
    for name, part, which in (
        ("along", 0, slice(None)), ("across", 1, slice(None)), ("straight", 0, straight)
    ):  # fmt: skip
        ratio = rms(ends["constraint"][part][which]) / rms(ends["none"][part][which])
        how = "Share that the constraint takes, RMS after 40 s, all outages."
        found[f"taken.{name}"] = 100 * (1 - ratio), "%", how
    far = np.hypot(*ends["constraint"]) > 20
    for name, which in (("straight", straight), ("other", ~straight)):
        how = "Outages that end more than 20 m off with the constraint."
        found[f"lost.{name}"] = float(100 * far[which].mean()), "%", how
    found["alone.across"] = rms(ends["constraint"][1]), "m", "RMS after 40 s, constraint alone."
    right, off = navigate(np.zeros(3))[40], {}
    for name, turn in (("tilted", (0.0, 0.05, 0.0)), ("headed", (0.0, 0.0, 2.0))):
        off[name] = float(np.hypot(*(navigate(np.radians(turn))[40] - right)[:2]))
        found[name] = off[name], "m", "Of the INS at 153 s, begun with this turn at 113 s."
    _, C, _, P = in_metres(plain.states[113, 0])
    tilts = np.array([[0, -_GRAVITY], [_GRAVITY, 0]])  # what a tilt adds to east and north
    pushed = np.hstack([np.zeros((2, 6)), tilts, np.zeros((2, 1)), C[:2], np.zeros((2, 3))])
    level = float(np.degrees(np.diag(pushed @ P @ pushed.T)[0] ** 0.5 / _GRAVITY))
    heading = float(np.degrees(P[8, 8] ** 0.5))
    costs = {"level": _by_tilt(level), "heading": off["headed"] * heading / 2}
    for name, k in (("early", 30), ("late", 113)):
        how = f"Correlation of what tilt and accelerometer bias add along the car, at {k} s."
        found[f"alike.{name}"] = _alike(plain, k), "1", how
    for name, value in (("level", level), ("heading", heading)):
        found[f"sure.{name}"] = value, "deg", "Standard deviation with GPS, at 113 s."
        found[f"costs.{name}"] = costs[name], "m", "What that leads to 40 s later."
    found["free.without"] = _by_tilt(0.1), "m", "The formula g tilt t^2 / 2."
    found["free.with"] = float(14 * np.radians(0.5) * LENGTH), "m", "The formula v psi t."
    seen = constrain(np.eye(2), 0.0)
    turn = brentq(lambda q: constrain(seen, q)[1, 1] ** 0.5 - 0.5, 0, np.pi / 2)
    found["halves"] = float(np.degrees(turn)), "deg", "Turn that halves the velocity error along."
    found["earth"] = float(np.degrees(7.292e-5 * LENGTH)), "deg", "The turn of the earth in 40 s."
    return found


_GRAVITY = 9.795  # m/s²


def _by_tilt(degrees: float) -> float:
    return float(_GRAVITY * np.radians(degrees) * LENGTH**2 / 2)


def recorded_numbers(in_town: Mapping[str, tuple[Array, Array]], least: float) -> Said:
    """Return what the text says of the recorded drive."""
    found: Said = {"recorded.least": (least, "deg", "Least range of the heading in an outage.")}
    for name, what in (("ins", "never"), ("aided", "through")):
        for part, where in zip(in_town[what], ("along", "across"), strict=True):
            found[f"recorded.{name}.{where}"] = rms(part), "m", "RMS after 40 s, twelve outages."
    return found
