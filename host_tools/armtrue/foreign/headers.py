"""Meaning of foreign columns by their headers: words of common instruments, controllers and languages."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field

import numpy as np

from armtrue.arrays import Array
from armtrue.foreign.clocks import kind_of_texts
from armtrue.foreign.sheets import Sheet, split_unit, to_float
from armtrue.io.columns import UNITS
from armtrue.io.delimited import is_number

_PLANNED = re.compile(r"goal|nominal|nom\b|soll|planned|desired|design", re.IGNORECASE)
_SPREAD = re.compile(r"std|sigma|rms|uncert|^u95\b|deviation|dev\b|error", re.IGNORECASE)
_READ_BACK = re.compile(r"act|meas|fb|feedback|readback|read_back|\bist\b", re.IGNORECASE)
_JOINT = re.compile(
    r"(?:^|.*[_ .\-/])?(?:q|j|a|th|ax|joint|axis|axe|achse|gelenk|theta|jnt|robax|rax|joint_?pos|joint_?angle|"
    r"actual_q|target_q)[_ .\-#(]*([0-9]{1,2})\)?"
    r"(?:[_ .\-](?:act\w*|cmd|command\w*|meas\w*|fb|target|pos\w*|deg|rad))?$",
    re.IGNORECASE,
)
# Axes that carry the arm: E1 (KUKA), eax_a (ABB), rail, track …
_EXTERNAL = re.compile(
    r"^(?:(?:e|eax|ext|ext_?ax(?:is)?|external_?axis)[_ .\-]*[1-6a-f]|"
    r"(?:rail|track|slide|linear_?axis)(?:[_ .\-]?pos\w*)?)$",
    re.IGNORECASE,
)
_UR = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_AXIS = re.compile(r"^(.*?)(?<![a-z])(r?)([xyz])(?![a-z])(.*)$", re.IGNORECASE)
_ANGLES = (("roll", "pitch", "yaw"), ("a", "b", "c"), ("w", "p", "r"), ("rx", "ry", "rz"))
_QUATERNIONS = (
    *(("qw", "qx", "qy", "qz"), ("quat_w", "quat_x", "quat_y", "quat_z")),
    *(("q0", "q1", "q2", "q3"), ("q1", "q2", "q3", "q4")),
)
# Quaternions are rounded, and a few rows may be bad.
_UNIT_LENGTH_TOLERANCE = 2e-3
_MOST_BAD = 0.05
_WHOSE = re.compile(
    r"(?:measured|measurement|meas|tcp|pose|tool|cart(?:esian)?|robot|act(?:ual)?|leica|laser|tracker|smr)"
    r"(?:[_ .]pose)?",
    re.IGNORECASE,
)
# Nine direction cosines, row by row, counted from 1 or from 0: R11 … R33, rot_00 … rot_22.
_MATRICES = tuple(
    tuple(f"{stem}{i}{between}{k}" for i in digits for k in digits)
    for stem in ("r", "r_", "rot", "rot_", "m", "m_")
    for between in ("", "_", ",")
    for digits in ("123", "012")
)
_WORDS = {
    "payload": re.compile(
        r"payload|^load|^(?:nutz|trag)?last(?:_?kg)?$|tool_?mass|^mass(?:e|_?kg)?$|^weight", re.IGNORECASE
    ),
    "station": re.compile(
        r"^(?:station|set_?up|standpunkt)[_ .]*(?:id|nr|no|name|number|#)?$", re.IGNORECASE
    ),
    "nest": re.compile(r"^nest[_ .]*(?:id|nr|no|name|number|#)?$", re.IGNORECASE),
    "time": re.compile(r"^t$|time|zeit|stamp|date|datum|uhr|^elapsed", re.IGNORECASE),
    "repeat": re.compile(r"^rep|repeat|repetition|wdh|wiederhol", re.IGNORECASE),
    "target": re.compile(r"target|smr|reflector|prism|ball_?id", re.IGNORECASE),
}
_OF_THE_CONTRACT = re.compile(r"sigma|(?:dir|tau|travel|duty)[1-9]\d?")
_TEMPERATURE_WORDS = re.compile(r"measurement|meas|temp(?:erature?|eratur)?", re.IGNORECASE)
# Excludes the German Stempel, as in Zeitstempel (time stamp).
_TEMPERATURE = re.compile(r"temp(?!el)", re.IGNORECASE)
# Less certain words for temperatures: the values must also be those of a room or an arm, in °C, °F or K.
_PERHAPS_TEMPERATURE = re.compile(
    r"^t[_ .]?\d{1,2}$|^t[_ ][a-z]\w*$|ambient|umgebung|^room\b|^raum(?:luft)?\b|^coolant\b", re.IGNORECASE
)
_COLDEST, _HOTTEST = -30.0, 330.0
# A controller's pose with numbered components: actual_TCP_pose_0.
_OWN_POSE = re.compile(r"(?:^|[_ .])(?:tcp|tool)[_ .]?pose(?:$|[_ .\d])", re.IGNORECASE)
_DEVIATION = re.compile(
    r"^(?:d|delta|Δ|δ|dev|diff|difference|deviation|err|error)[_ .]?[xyz]$", re.IGNORECASE
)
_DEVIATION_LENGTH = re.compile(
    r"^(?:(?:d|delta|Δ|δ)?[_ .]?mag(?:nitude)?|d3d|3d|dist|distance)$", re.IGNORECASE
)
_KEYS = re.compile(
    r"^(?:point|pose|pos|nr|no|num|number|id|index|idx|name|label|row|#|punkt)[_ .]*(?:id|nr|no|name|number|#)?$",
    re.IGNORECASE,
)


@dataclass
class Meaning:
    """The columns recognised in a sheet: contract name → header.

    `points`: reflector name → headers of x, y, z. `rotations`: name of the owner → headers of three angles, a
    quaternion or a matrix; `rotation`: those of them that are used. `externals`: headers of moving axes that may carry
    the arm; `carry` makes joints of them. `variables`: own name → header, for further columns of numbers. `left`:
    header → why it is not used.
    """

    joints: dict[str, str] = field(default_factory=dict)
    points: dict[str, list[str]] = field(default_factory=dict)
    rotations: dict[str, list[str]] = field(default_factory=dict)
    rotation: list[str] = field(default_factory=list)
    others: dict[str, str] = field(default_factory=dict)
    key: str | None = None
    externals: list[str] = field(default_factory=list)
    variables: dict[str, str] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)

    def carry(self, joint_count: int) -> None:
        """Number the axes that carry the arm before its own joints if both together are `joint_count`."""
        own = sum(not name.startswith("qr") for name in self.joints)
        first = len(self.externals)
        if first == 0 or own == 0 or own + first != joint_count:
            return
        moved = {}
        for name, header in self.joints.items():
            stem = name.rstrip("0123456789")
            moved[f"{stem}{int(name[len(stem) :]) + first}"] = header
        self.joints = {f"q{k}": header for k, header in enumerate(self.externals, start=1)} | moved
        self.externals = []


def meaning(sheet: Sheet, joint_names: list[str]) -> Meaning:
    """Read the headers of `sheet`. `joint_names`: the arm's own, which a controller's export may use."""
    found = Meaning()
    plain = {name: split_unit(name)[0] for name in sheet.header}
    found.joints = _joints(sheet, plain, joint_names)
    taken = set(found.joints.values())
    found.externals = [
        name
        for name, word in plain.items()
        if name not in taken and _EXTERNAL.match(word) and len(set(sheet.cells(name))) > 1
    ]
    taken |= set(found.externals)
    found.rotations = _rotations(sheet, {name: word for name, word in plain.items() if name not in taken})
    found.rotation = next(iter(found.rotations.values()), [])
    taken |= {name for headers in found.rotations.values() for name in headers}
    found.points = _points({name: word for name, word in plain.items() if name not in taken})
    taken |= {name for headers in found.points.values() for name in headers}
    clock = _clock(sheet, [name for name in plain if name not in taken])
    if clock is not None:
        found.others["time"] = clock
        taken.add(clock)
    for name, word in plain.items():
        if name not in taken:
            _take(found, sheet, name, word)
    return found


def _take(found: Meaning, sheet: Sheet, name: str, word: str) -> None:
    """Take a column that is no joint, point or orientation, or say why not."""
    if _OF_THE_CONTRACT.fullmatch(word):
        found.others[word] = name
        return
    if why := _why_left(sheet, name, word):
        found.left[name] = why
        return
    own = next((own for own, words in _WORDS.items() if words.search(word)), "")
    if sensor := _sensor(sheet, name, word):
        own = f"temp_{sensor}"
    if own == "target" and 2 * len(set(sheet.cells(name))) > len(sheet.rows):
        found.key = found.key or name
        found.left[name] = "it names single points, which is used to match files"
    elif own and own in found.others:
        found.left[name] = f"{own} is taken from {found.others[own]}"
    elif own:
        found.others[own] = name
    elif _KEYS.match(word):
        found.key = found.key or name
        found.left[name] = "it numbers rows, which is used to match files"
    else:
        _take_as_variable(found, sheet, name, word)


def _why_left(sheet: Sheet, name: str, word: str) -> str:
    """Why a column is left out because of its name, whatever its values; empty if it is not."""
    if _OWN_POSE.search(word):
        return "by its name it is the controller's own pose, which is not a measurement"
    if _PLANNED.search(word):
        return "it looks like a nominal value"
    if _DEVIATION.match(word):
        return f"it is {_deviation(sheet, name) or 'by its name a deviation from the nominal value'}"
    if _DEVIATION_LENGTH.match(word) and any(_DEVIATION.match(split_unit(own)[0]) for own in sheet.header):
        return "it is the length of a deviation by its name"
    return ""


def _deviation(sheet: Sheet, name: str) -> str:
    """The two columns of one axis whose difference this column is, `Actual X minus Nominal X`; empty if none."""
    axis = split_unit(name)[0][-1].lower()
    wanted = _figures(sheet, [name])
    beside = []
    for own in sheet.header:
        match = _AXIS.match(split_unit(own)[0].replace("_", " "))
        if own != name and match and not match[2] and match[3].lower() == axis:
            beside.append((own, _figures(sheet, [own])))
    for one, values in beside:
        for other, less in beside:
            largest = float(np.nanmax(np.abs(values), initial=0.0))
            if one != other and np.allclose(values - less, wanted, rtol=0.0, atol=1e-5 * largest):
                return f"{one} minus {other}"
    return ""


def _sensor(sheet: Sheet, name: str, word: str) -> str:
    """The name of the temperature sensor of a column; empty if the column holds no temperature."""
    unit = sheet.units.get(name)
    sure = _TEMPERATURE.search(word) or (unit is not None and UNITS[unit][0] == "temperature")
    if not sure:
        values = _figures(sheet, [name])
        usual = np.isfinite(values).all() and values.min() > _COLDEST and values.max() < _HOTTEST
        if not _PERHAPS_TEMPERATURE.search(word) or not usual:
            return ""
    plain = unicodedata.normalize("NFKD", _TEMPERATURE_WORDS.sub("", word)).encode("ascii", "ignore").decode()
    plain = re.sub(r"[_ .][fc]$", "", plain, flags=re.IGNORECASE).strip()
    plain = re.sub(r"^t[_ ](?=[a-z])", "", plain, flags=re.IGNORECASE)
    return re.sub(r"\W+", "_", plain).strip("_").lower() or "air"


def _clock(sheet: Sheet, names: list[str]) -> str | None:
    """The column of clock times, whatever its header; of several, one whose header has a word for time."""
    clocks = [name for name in names if kind_of_texts(sheet.cells(name))]
    return next((name for name in clocks if _WORDS["time"].search(name)), next(iter(clocks), None))


def _take_as_variable(found: Meaning, sheet: Sheet, name: str, word: str) -> None:
    """Take a column outside the contract as a variable under its own name, or note why not."""
    own = re.sub(r"\W+", "_", word, flags=re.ASCII).strip("_")
    own = own if own.isidentifier() else f"column_{own}"
    if _SPREAD.search(word):
        found.left[name] = "it looks like the spread of readings"
    elif _JOINT.match(word) or _AXIS.match(word.replace("_", " ")):
        found.left[name] = "it looks like a joint, a point or an angle beside those that are taken"
    elif len(set(sheet.cells(name))) < 2:
        found.left[name] = "it is the same in all rows"
    elif name.isdigit():
        found.left[name] = "it has no name"
    elif not sheet.is_numeric(name):
        found.left[name] = "it holds more than numbers"
    elif own in found.variables:
        found.left[name] = f"{own} is taken from {found.variables[own]}"
    else:
        found.variables[own] = name


def _joints(sheet: Sheet, plain: dict[str, str], joint_names: list[str]) -> dict[str, str]:
    by_word = {word.lower(): name for name, word in plain.items()}
    if joint_names and all(name.lower() in by_word for name in joint_names):
        return {f"q{k}": by_word[name.lower()] for k, name in enumerate(joint_names, start=1)}
    ur = {part: next((name for name, word in plain.items() if part in word.lower()), None) for part in _UR}
    if all(ur.values()):
        return {f"q{k}": str(name) for k, name in enumerate(ur.values(), start=1)}
    # Columns whose headers differ only in the number form one set: q0 … q3 are no joints beside J1 … J6.
    alike: dict[str, dict[str, dict[int, str]]] = {"q": {}, "qr": {}}
    for name, word in plain.items():
        match = _JOINT.match(word)
        if match and not _SPREAD.search(word):
            kind = "qr" if re.match(r"qr", word, re.IGNORECASE) or _READ_BACK.search(word) else "q"
            stem = f"{word[: match.start(1)]}#{word[match.end(1) :]}".lower()
            alike[kind].setdefault(stem, {}).setdefault(int(match[1]), name)
    for sets in alike.values():
        for stem, numbered in list(sets.items()):
            if len(numbered) == 4 and _of_unit_length(sheet, list(numbered.values())):
                del sets[stem]
    if not alike["q"]:
        alike = {"q": alike["qr"], "qr": {}}
    joints: dict[str, str] = {}
    for kind, sets in alike.items():
        run = _longest_run(list(sets.values()), len(joint_names))
        joints |= {f"{kind}{k}": name for k, name in enumerate(run, start=1)}
    return joints


def _longest_run(sets: list[dict[int, str]], wanted: int) -> list[str]:
    """The headers, numbered without a gap, of the set that has `wanted` of them (0: unknown), else of the longest.

    If no set has enough, all are merged into one, as names may differ in more than their number.
    """
    if not sets:
        return []

    def run(numbered: dict[int, str]) -> list[str]:
        first = 0 if 0 in numbered else 1
        count = next((k for k in range(len(numbered) + 1) if first + k not in numbered), 0)
        return [numbered[first + k] for k in range(count)]

    runs = [run(numbered) for numbered in sets]
    best = max(runs, key=lambda names: (len(names) == wanted, len(names)))
    if len(best) >= wanted:
        return best
    merged: dict[int, str] = {}
    for numbered in sets:
        merged = numbered | merged
    together = run(merged)
    return together if len(together) > len(best) else best


def _figures(sheet: Sheet, names: list[str]) -> Array:
    """Columns as numbers (N,) or (N, k), NaN where a cell holds none."""

    def figure(cell: str) -> float:
        return to_float(cell, sheet.decimal) if is_number(cell, sheet.decimal) else np.nan

    figures = np.array([[figure(cell) for cell in sheet.cells(name)] for name in names])
    return figures[0] if len(names) == 1 else figures.T


def _of_unit_length(sheet: Sheet, names: list[str]) -> bool:
    """True where the columns hold quaternions."""
    off = np.abs(np.linalg.norm(_figures(sheet, names), axis=1) - 1.0)
    return bool(np.mean(~(off < _UNIT_LENGTH_TOLERANCE)) <= _MOST_BAD)


def _rotations(sheet: Sheet, plain: dict[str, str]) -> dict[str, list[str]]:
    """Headers of orientations, keyed by the words before them: `TCP` for `TCP RX, TCP RY, TCP RZ`."""
    words: dict[str, dict[str, str]] = {}
    parts = {part for group in (*_MATRICES, *_QUATERNIONS, *_ANGLES) for part in group}
    for name, word in plain.items():
        if _PLANNED.search(word) or _SPREAD.search(word):
            continue
        for at in range(len(word)):
            # A single letter is an angle only after certain words (`_WHOSE`): Motor A is none.
            whose = word[:at].rstrip("_ .")
            begins = at == 0 or (word[at - 1] in "_ ." and (len(word) - at > 1 or _WHOSE.fullmatch(whose)))
            if begins and word[at:].lower() in parts:
                owner = " ".join(whose.replace("_", " ").split())
                words.setdefault(owner, {}).setdefault(word[at:].lower(), name)
                break
    found: dict[str, list[str]] = {}
    for whose, own in words.items():
        for group in (*_MATRICES, *_QUATERNIONS, *_ANGLES):
            headers = [own[part] for part in group if part in own]
            like_joints = group[0] in ("q0", "q1")
            if len(headers) == len(group) and (not like_joints or _of_unit_length(sheet, headers)):
                found[whose] = headers
                break
    return found


def _points(plain: dict[str, str]) -> dict[str, list[str]]:
    """Triples of x, y, z: names that differ in the axis letter only. Planned values and spreads are not used."""
    groups: dict[str, dict[str, str]] = {}
    for name, word in plain.items():
        match = _AXIS.match(word.replace("_", " "))
        passed = _PLANNED.search(word) or _SPREAD.search(word) or _DEVIATION.match(word)
        if match and not match[2] and not passed:
            rest = " ".join(f"{match[1]} {match[4]}".split())
            groups.setdefault(rest, {})[match[3].lower()] = name
    numbered = re.compile(r"^([xyz])_?([0-9A-Za-z]{1,3})$", re.IGNORECASE)
    for name, word in plain.items():
        if match := numbered.match(word):
            groups.setdefault(match[2], {})[match[1].lower()] = name
    return {key: [group[axis] for axis in "xyz"] for key, group in groups.items() if len(group) == 3}
