"""What a foreign column holds, by its header: words of common instruments, controllers and languages."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from armtrue.foreign.sheets import Sheet, is_number, split_unit, time_format

_PLANNED = re.compile(r"goal|nominal|nom\b|soll|planned|desired|design", re.IGNORECASE)
_SPREAD = re.compile(r"std|sigma|rms|uncert|deviation|dev\b|error", re.IGNORECASE)
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
_QUATERNIONS = (("qw", "qx", "qy", "qz"), ("quat_w", "quat_x", "quat_y", "quat_z"), ("q0", "q1", "q2", "q3"))
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
    "time": re.compile(r"^t$|time|zeit|stamp|date|datum|uhr", re.IGNORECASE),
    "repeat": re.compile(r"^rep|repeat|repetition|wdh|wiederhol", re.IGNORECASE),
    "target": re.compile(r"target|smr|reflector|prism|ball_?id", re.IGNORECASE),
}
_OF_THE_CONTRACT = re.compile(r"sigma|(?:dir|tau|travel|duty)[1-9]\d?")
_TEMPERATURE_WORDS = re.compile(r"measurement|meas|temp(?:erature?|eratur)?", re.IGNORECASE)
# Not the German Stempel, of Zeitstempel.
_TEMPERATURE = re.compile(r"temp(?!el)", re.IGNORECASE)
_KEYS = re.compile(
    r"^(?:point|pose|pos|nr|no|num|number|id|index|idx|name|label|row|#|punkt)[_ .]*(?:id|nr|no|name|number|#)?$",
    re.IGNORECASE,
)


@dataclass
class Meaning:
    """What a sheet holds: contract name → header, for the columns that were recognised.

    `points`: reflector name → headers of x, y, z. `rotation`: headers of three angles or a quaternion. `externals`:
    headers of axes that may carry the arm and that move; `carry` makes joints of them. `variables`: names of one's own
    → header, for further columns of numbers. `left`: header → why it is not taken.
    """

    joints: dict[str, str] = field(default_factory=dict)
    points: dict[str, list[str]] = field(default_factory=dict)
    rotation: list[str] = field(default_factory=list)
    others: dict[str, str] = field(default_factory=dict)
    key: str | None = None
    externals: list[str] = field(default_factory=list)
    variables: dict[str, str] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)

    def carry(self, joint_count: int) -> None:
        """Put the axes that carry the arm before its own joints where both together are `joint_count`."""
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
    found.joints = _joints(plain, joint_names)
    taken = set(found.joints.values())
    found.externals = [
        name
        for name, word in plain.items()
        if name not in taken and _EXTERNAL.match(word) and len(set(sheet.cells(name))) > 1
    ]
    taken |= set(found.externals)
    found.rotation = _rotation({name: word for name, word in plain.items() if name not in taken})
    taken |= set(found.rotation)
    found.points = _points({name: word for name, word in plain.items() if name not in taken})
    taken |= {name for headers in found.points.values() for name in headers}
    clock = _clock(sheet, [name for name in plain if name not in taken])
    if clock is not None:
        found.others["time"] = clock
        taken.add(clock)
    for name, word in plain.items():
        if name in taken:
            continue
        if _OF_THE_CONTRACT.fullmatch(word):
            found.others[word] = name
            continue
        if _PLANNED.search(word):
            found.left[name] = "it looks like what was planned"
            continue
        if _TEMPERATURE.search(word):
            sensor = re.sub(r"\W+", "_", _TEMPERATURE_WORDS.sub("", word))
            own = f"temp_{sensor.strip('_').lower() or 'air'}"
        else:
            own = next((own for own, words in _WORDS.items() if words.search(word)), "")
        if own and own in found.others:
            found.left[name] = f"{own} is taken from {found.others[own]}"
        elif own:
            found.others[own] = name
        elif _KEYS.match(word):
            found.key = found.key or name
            found.left[name] = "it numbers rows, which is used to match files"
        else:
            _take_as_variable(found, sheet, name, word)
    return found


def _clock(sheet: Sheet, names: list[str]) -> str | None:
    """The column of clock times, whatever its header; of several the one with a header that says time."""
    clocks = [name for name in names if ":" in sheet.cells(name)[0] and time_format(sheet.cells(name))]
    return next((name for name in clocks if _WORDS["time"].search(name)), next(iter(clocks), None))


def _take_as_variable(found: Meaning, sheet: Sheet, name: str, word: str) -> None:
    """Take a column that has no name of the contract as one under its own, or say why not."""
    cells = sheet.cells(name)
    own = re.sub(r"\W+", "_", word, flags=re.ASCII).strip("_")
    own = own if own.isidentifier() else f"column_{own}"
    if _SPREAD.search(word):
        found.left[name] = "it looks like the spread of readings"
    elif _JOINT.match(word) or _AXIS.match(word.replace("_", " ")):
        found.left[name] = "it looks like a joint, a point or an angle beside those that are taken"
    elif len(set(cells)) < 2:
        found.left[name] = "it is the same in all rows"
    elif not all(is_number(cell, sheet.decimal) for cell in cells):
        found.left[name] = "it holds more than numbers"
    elif own in found.variables:
        found.left[name] = f"{own} is taken from {found.variables[own]}"
    else:
        found.variables[own] = name


def _joints(plain: dict[str, str], joint_names: list[str]) -> dict[str, str]:
    by_word = {word.lower(): name for name, word in plain.items()}
    if joint_names and all(name.lower() in by_word for name in joint_names):
        return {f"q{k}": by_word[name.lower()] for k, name in enumerate(joint_names, start=1)}
    ur = {part: next((name for name, word in plain.items() if part in word.lower()), None) for part in _UR}
    if all(ur.values()):
        return {f"q{k}": str(name) for k, name in enumerate(ur.values(), start=1)}
    sets: dict[str, dict[int, str]] = {"q": {}, "qr": {}}
    for name, word in plain.items():
        match = _JOINT.match(word)
        if match and not _SPREAD.search(word):
            kind = "qr" if re.match(r"qr", word, re.IGNORECASE) or _READ_BACK.search(word) else "q"
            sets[kind].setdefault(int(match[1]), name)
    if not sets["q"]:
        sets = {"q": sets["qr"], "qr": {}}
    joints: dict[str, str] = {}
    for kind, numbered in sets.items():
        first = 0 if 0 in numbered else 1
        count = next((k for k in range(len(numbered) + 1) if first + k not in numbered), 0)
        joints |= {f"{kind}{k + 1}": numbered[first + k] for k in range(count)}
    return joints


def _rotation(plain: dict[str, str]) -> list[str]:
    words: dict[str, str] = {}
    for name, word in plain.items():
        if not _PLANNED.search(word) and not _SPREAD.search(word):
            words.setdefault(re.sub(r"^(measured|measurement|meas|tcp|pose)[_ .]*", "", word.lower()), name)
    for group in (*_MATRICES, *_QUATERNIONS, *_ANGLES):
        if all(part in words for part in group):
            return [words[part] for part in group]
    return []


def _points(plain: dict[str, str]) -> dict[str, list[str]]:
    """Triples of x, y, z: names that differ in the axis letter only. What was planned or is a spread is passed over."""
    groups: dict[str, dict[str, str]] = {}
    for name, word in plain.items():
        match = _AXIS.match(word.replace("_", " "))
        if match and not match[2] and not _PLANNED.search(word) and not _SPREAD.search(word):
            rest = " ".join(f"{match[1]} {match[4]}".split())
            groups.setdefault(rest, {})[match[3].lower()] = name
    numbered = re.compile(r"^([xyz])_?([0-9A-Za-z]{1,3})$", re.IGNORECASE)
    for name, word in plain.items():
        if match := numbered.match(word):
            groups.setdefault(match[2], {})[match[1].lower()] = name
    whole = {key: [group[axis] for axis in "xyz"] for key, group in groups.items() if len(group) == 3}
    measured = {key: names for key, names in whole.items() if _READ_BACK.search(key)}
    return measured if measured and len(whole) > len(measured) else whole
