"""Picture of an effect: the arm with the effect's joints marked, and its displacement, enlarged to be visible."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from armtrue import _core
from armtrue.arrays import Array
from armtrue.candidates import joint_words
from armtrue.fitting import Fit, effect_terms
from armtrue.io.rotation import matrix_about
from armtrue.report.gathered.state import Variable, variables
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import fixed
from armtrue.tables.chain import Chain, chain_from_robot
from armtrue.units import plural

WIDTH, HEIGHT = 310, 240
_TRACK = 40  # height below the picture for the scale of the variable that drives the effect
_FRAMES = 17
_SECONDS = 6
_MARGIN = 26.0
# Largest displacement as drawn, as a share of the arm's size.
_SEEN = 0.14
_LARGEST_ANGLE = 0.6
_BETWEEN = (0.02, 0.98)
_SHOWN_WAVES = 2.0
# Larger displacements are not to scale: their terms are weighted by compliances that are not fitted yet.
_LARGEST_REAL_M = 0.05
# Labels of joints: a line's height, a letter's width, and how far beside the joint they stand.
_LINE, _LETTER, _BESIDE = 16.0, 8.0, 12.0
_AZIMUTH, _ELEVATION = np.radians(-62.0), np.radians(22.0)


@dataclass(frozen=True)
class Sweep:
    """An effect while one recorded variable runs through its range and all others stay constant.

    `values` (M,) of the variable; `moves`: displacement (M,) by coordinate; `document`: the effect's terms.
    """

    variable: Variable | None
    values: Array
    moves: dict[str, Array]
    document: dict[str, Any]


def typical_pose(joints: Array) -> int:
    """The row of joints (N, n) that is nearest to the median of all."""
    spread = np.maximum(np.ptp(joints, axis=0), 1e-9)
    return int(np.argmin(np.sum(((joints - np.median(joints, axis=0)) / spread) ** 2, axis=1)))


def effect_picture(fit: Fit, candidate: dict[str, Any], sweep: Sweep) -> tuple[Markup, str]:
    """The picture of a candidate on the arm of `fit`, and its caption."""
    chain = chain_from_robot(fit.document["robot"])
    row = typical_pose(fit.data.joints)
    nominal = corners(chain, fit.data.joints[row], {})
    frames = range(len(sweep.values))
    size = float(np.linalg.norm(np.ptp(nominal, axis=0)))

    def moved(gain: float) -> list[Array]:
        return [
            corners(chain, fit.data.joints[row], {c: gain * v[k] for c, v in sweep.moves.items()})
            for k in frames
        ]

    far = max((float(np.linalg.norm(places - nominal, axis=1).max()) for places in moved(1.0)), default=0.0)
    turn = max((float(np.abs(v).max()) for c, v in sweep.moves.items() if _turns(chain, c)), default=0.0)
    gain = min(_SEEN * size / (far or 1.0), _LARGEST_ANGLE / (turn or 1e-9))
    drawn = moved(gain)
    places = projected([nominal, *drawn])
    words = _words(sweep, candidate, far, gain)
    marked = [k for k in candidate["joints"] if k <= chain.joint_count]
    return _svg(places[0], places[1:], marked, sweep, words), words


def effect_sweep(fit: Fit, candidate: dict[str, Any]) -> Sweep | None:
    """The sweep of the variable that changes an effect most; None where the effect has no terms on this arm."""
    joints = candidate["joints"]
    row = typical_pose(fit.data.joints)
    at_rest = {name: float(values[row]) for name, values in fit.data.columns.items() if name != "target"}
    best: Sweep | None = None
    largest = -1.0
    for variable, columns in _drivers(fit, joints):
        rows: dict[str, Array] = {name: np.full(_FRAMES, value) for name, value in at_rest.items()}
        low, high = _range(fit, candidate, columns[0], at_rest)
        values: Array = np.linspace(low, high, _FRAMES, dtype=np.float64)
        if columns[0].startswith("dir"):
            values = np.where(np.arange(_FRAMES) < _FRAMES // 2, -1.0, 1.0)
        for name in columns:
            rows[name] = values if name in columns[:1] else rows[name] + values - at_rest[columns[0]]
        try:
            document = effect_terms(fit, candidate, rows)
        except _core.ModelError:
            return None
        moves = _moves(document, candidate)
        course = max((float(np.ptp(v)) for v in moves.values()), default=0.0)
        if course > (1.0 + 1e-6) * largest:
            # In the display unit, which is a linear function of the column.
            si, drawn = fit.data.columns[columns[0]], variable.values
            shown = np.interp(values, [si.min(), si.max()], [drawn.min(), drawn.max()])
            best, largest = Sweep(variable, np.asarray(shown), moves, document), course
    if best is not None and largest <= 0.0:
        # No variable changes it: the picture shows the effect growing from zero and back.
        grown: Array = np.linspace(0.0, 1.0, _FRAMES, dtype=np.float64)
        best = Sweep(None, grown, {c: v * grown for c, v in best.moves.items()}, best.document)
    return best


def _range(
    fit: Fit, candidate: dict[str, Any], column: str, at_rest: dict[str, float]
) -> tuple[float, float]:
    """The range of a column in the data; for an effect of short waves, two waves around the pose at rest."""
    low, high = (float(end) for end in np.quantile(fit.data.columns[column], _BETWEEN))
    options, joints = candidate.get("options") or {}, candidate["joints"]
    waves = list(options.get("cycles") or [])
    waves += [2.0 * np.pi / length for length in options.get("wavelengths") or []]
    if options.get("orders") and joints:
        joint = fit.robot.joints[joints[-1] - 1]
        lead = options.get("lead") or joint.get("lead")
        once = 2.0 * np.pi / lead if lead else joint.get("gear_ratio") or 1.0
        waves += [abs(order * once) for order in options["orders"]]
    if waves and column.startswith("q"):
        half = min(high - low, _SHOWN_WAVES * 2.0 * np.pi / max(waves)) / 2.0
        low, high = at_rest[column] - half, at_rest[column] + half
    return low, high


def arms_picture(fit: Fit, joints: Array) -> tuple[Markup, str]:
    """A picture of the arm at each of the motor-side `joints` (N, n), and its caption."""
    chain = chain_from_robot(fit.document["robot"])
    here = corners(chain, fit.data.joints[typical_pose(fit.data.joints)], {})
    places = projected([here, *(corners(chain, row, {}) for row in joints)])
    words = f"The arm at {plural(len(joints), 'planned pose')}; a dot marks the flange."
    arms = [tag("path", class_="planned-arm", d=path(place)) for place in places[1:]]
    ends = [
        tag("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r="4") for x, y in (place[-1] for place in places[1:])
    ]
    return framed(words, tag("path", class_="arm", d=path(places[0])), arms, ends), words


def framed(words: str, *drawn: Content, **attributes: object) -> Markup:
    """A picture of an arm as an SVG element; `words` is its text for screen readers."""
    return tag(
        "svg", tag("title", words), *drawn, class_="panel effect-picture", role="img",
        viewBox=f"0 0 {WIDTH} {HEIGHT}", aria_label=words, **attributes,
    )  # fmt: skip


def _drivers(fit: Fit, joints: list[int]) -> list[tuple[Variable, list[str]]]:
    """Variables that may drive an effect on `joints`, the likeliest first, with their columns."""
    columns = fit.data.columns
    found = {variable.name: variable for variable in variables(fit)}
    numbers = [*reversed(joints), *(k for k in range(1, len(fit.robot.joints) + 1) if k not in joints)]
    names = [*(f"dir{k}" for k in joints), *(f"q{k}" for k in numbers)]
    names += [*(n for n in found if n.startswith("temp_")), "payload", "time"]
    names += [n for n in columns if n not in ("x", "y", "z")]
    known = [name for name in dict.fromkeys(names) if name in found and name in columns]
    read_back = {name: [f"qr{name[1:]}"] for name in known if name[0] == "q" and f"qr{name[1:]}" in columns}
    return [(found[name], [name, *read_back.get(name, [])]) for name in known]


def _moves(document: dict[str, Any], candidate: dict[str, Any]) -> dict[str, Array]:
    """Displacement of every coordinate over the sweep, with the candidate's coefficients."""
    known = {p["name"]: float(p["value"]) for p in candidate["parameters"]}
    moves: dict[str, Array] = {}
    for parameter in document["parameters"]:
        value = known.get(parameter["name"], 0.0)
        for term in parameter["terms"]:
            move = value * float(term["weight"]) * np.broadcast_to(np.asarray(term["values"]), (_FRAMES,))
            moves[term["coordinate"]] = moves.get(term["coordinate"], 0.0) + move
    return moves


def _turns(chain: Chain, coordinate: str) -> bool:
    motor = re.fullmatch(r"motor(\d+)", coordinate)
    return not chain.prismatic[int(motor[1]) - 1] if motor else ".r" in coordinate


def corners(chain: Chain, joints: Array, moves: dict[str, float]) -> Array:
    """Corners (n + 2, 3) [m] of the arm in its base frame, displaced: base, joints 1 to n, flange."""
    frames = [frame[0] for frame in chain.frames(joints[None, :])]
    end = frames[-1] @ chain.end
    places = np.array([np.zeros(3), *(frame[:3, 3] for frame in frames), end[:3, 3]])
    steps: list[tuple[int, Array, str, float]] = []
    for coordinate, move in moves.items():
        if motor := re.fullmatch(r"motor(\d+)", coordinate):
            for k in np.flatnonzero(chain.coupling[:, int(motor[1]) - 1]):
                share = float(chain.coupling[k, int(motor[1]) - 1]) * move
                steps.append((int(k) + 1, frames[k], "tz" if chain.prismatic[k] else "rz", share))
            continue
        where, _, component = coordinate.partition(".")
        link = re.fullmatch(r"link(\d+)", where)
        number = int(link[1]) if link else 0 if where == "base" else len(frames)
        frame = np.eye(4) if number == 0 else end if not link else frames[number - 1]
        steps.append((number, frame, component, move))
    # From the flange to the base, so that every axis is still at its nominal place when it moves what it carries.
    for number, frame, component, move in sorted(steps, key=lambda step: -step[0]):
        axis = "xyz".index(component[1])
        beyond = np.arange(len(places)) > number if number else np.ones(len(places), dtype=np.bool_)
        if component[0] == "t":
            places[beyond] += move * frame[:3, axis]
        else:
            turn = frame[:3, :3] @ matrix_about(component[1], move) @ frame[:3, :3].T
            places[beyond] = (places[beyond] - frame[:3, 3]) @ turn.T + frame[:3, 3]
    return places


def projected(shapes: list[Array]) -> list[Array]:
    """Shapes (M, 3) as places (M, 2) in the picture, all to one scale, seen from beside the arm and above."""
    reach = shapes[0][-1] - shapes[0][0]
    azimuth = float(np.arctan2(reach[1], reach[0])) + _AZIMUTH
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(_ELEVATION), np.sin(_ELEVATION)
    axes = np.array([[-sa, ca, 0.0], [se * ca, se * sa, -ce]])
    flat = [shape @ axes.T for shape in shapes]
    everything = np.concatenate(flat)
    low, high = everything.min(axis=0), everything.max(axis=0)
    room = np.array([WIDTH - 2 * _MARGIN, HEIGHT - _TRACK - 2 * _MARGIN])
    scale = float(np.min(room / np.maximum(high - low, 1e-9)))
    centre = np.array([WIDTH / 2, (HEIGHT - _TRACK) / 2])
    return [(place - (low + high) / 2) * scale + centre for place in flat]


def _svg(nominal: Array, moved: list[Array], marked: list[int], sweep: Sweep, words: str) -> Markup:
    there_and_back = [*range(len(moved)), *range(len(moved) - 2, -1, -1)]
    paths = [path(places) for places in moved]
    farthest = max(range(len(moved)), key=lambda k: float(np.abs(moved[k] - nominal).max()))
    joints = [
        tag("circle", class_="marked-joint" if k in marked else "plain-joint", cx=f"{x:.1f}", cy=f"{y:.1f}",
            r="8" if k in marked else "4")
        for k, (x, y) in enumerate(nominal[1:-1], start=1)
    ]  # fmt: skip
    names = [
        tag("text", text, class_="label strong", x=f"{x:.1f}", y=f"{y:.1f}")
        for text, x, y in joint_labels(nominal, marked)
    ]
    track: list[Markup] = []
    if sweep.variable is not None:
        left, right, y = _MARGIN, WIDTH - _MARGIN, HEIGHT - 24
        share = (sweep.values - sweep.values[0]) / (float(sweep.values[-1] - sweep.values[0]) or 1.0)
        at = [f"{left + (right - left) * float(s):.1f}" for s in share]
        unit = sweep.variable.unit if sweep.variable.unit in ("", "°") else f" {sweep.variable.unit}"
        track = [
            tag("path", class_="axis", d=f"M{left} {y}H{right}"),
            tag("circle", _animated("cx", [at[k] for k in there_and_back]), class_="driver", cx=at[farthest],
                cy=y, r="5"),
            tag("text", f"{_figure(sweep.values[0])}{unit}", class_="ticks", x=left, y=y + 18),
            tag("text", f"{_figure(sweep.values[-1])}{unit}", class_="ticks", x=right, y=y + 18, text_anchor="end"),
            tag("text", sweep.variable.what, class_="ticks", x=WIDTH / 2, y=y - 9, text_anchor="middle"),
        ]  # fmt: skip
    swing = _animated("d", [paths[k] for k in there_and_back])
    return framed(
        words,
        tag("path", class_="arm", d=path(nominal)),
        tag("path", swing, class_="moved-arm", d=paths[farthest]),
        joints, names, track,
        data_still=f"{_SECONDS * farthest / (len(there_and_back) - 1):.2f}",
    )  # fmt: skip


def joint_labels(places: Array, marked: list[int]) -> list[tuple[str, float, float]]:
    """Text and place of the labels of marked joints; joints whose labels would cover each other share one."""
    groups = [[k] for k in marked]
    while True:
        labels = [_label(places, group) for group in groups]
        covered = (
            (a, b) for a, b in combinations(range(len(groups)), 2) if _cover_each_other(labels[a], labels[b])
        )
        if (pair := next(covered, None)) is None:
            return labels
        merged = sorted(groups[pair[0]] + groups[pair[1]])
        groups = [merged, *(group for k, group in enumerate(groups) if k not in pair)]


def _label(places: Array, joints: list[int]) -> tuple[str, float, float]:
    text = f"joint{'s' if len(joints) > 1 else ''} {joint_words(joints)}"
    x, y = float(places[joints, 0].max()) + _BESIDE, float(places[joints, 1].mean()) + 4
    return text, min(x, WIDTH - _LETTER * len(text)), y


def _cover_each_other(one: tuple[str, float, float], other: tuple[str, float, float]) -> bool:
    left, right = sorted((one, other), key=lambda label: label[1])
    return abs(one[2] - other[2]) < _LINE and right[1] < left[1] + _LETTER * len(left[0])


def _animated(attribute: str, values: list[str]) -> Markup:
    how = {"values": ";".join(values), "dur": f"{_SECONDS}s", "repeatCount": "indefinite"}
    return tag("animate", attributeName=attribute, **how)


def path(places: Array) -> str:
    """A line through places (M, 2) as SVG writes it."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places)


def _figure(value: float) -> str:
    return fixed(float(value), 0 if abs(value) >= 10 else 1)


def _words(sweep: Sweep, candidate: dict[str, Any], far: float, gain: float) -> str:
    joints = candidate["joints"]
    named = f"joint{'s' if len(joints) > 1 else ''} {', '.join(map(str, joints))}"
    what = named if joints else "the arm"
    drives = ""
    if sweep.variable is not None and sweep.variable.name.startswith("dir"):
        drives = f" as joint {sweep.variable.joint} comes from one side and from the other"
    elif sweep.variable is not None:
        drives = f" as {sweep.variable.what} changes"
    size = f"{1e6 * far:.0f} µm" if far < 1e-3 else f"{1e3 * far:.1f} mm"
    shown = f"{float(f'{gain:.1g}'):,.0f}".replace(",", " ")
    scale = f": up to {size} here, drawn about × {shown}" if far < _LARGEST_REAL_M else ", not to scale"
    return (
        f"What the effect on {what} does{drives}{scale}. The arm stands still here, so that the displacement alone "
        "is seen."
    )
