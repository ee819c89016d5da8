"""`armtrue init`: robot.yaml, dataset.yaml and model.yaml from foreign files, with each guess and its reason."""

from __future__ import annotations

import contextlib
import json
import os
import re
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armtrue import _core
from armtrue.checking.alignment import align, alignment_columns, thinned
from armtrue.checking.orientations import rotation_that_follows
from armtrue.checking.report import Finding
from armtrue.checking.run import cheap_findings
from armtrue.errors import InputError, RowError
from armtrue.foreign import robots
from armtrue.foreign.clocks import join_date_and_time
from armtrue.foreign.column_units import codes_of_words, find_clock, find_geometry_units, find_units
from armtrue.foreign.combine import long_table, write_long
from armtrue.foreign.headers import meaning
from armtrue.foreign.own_pose import leave_out_own_poses
from armtrue.foreign.pairing import row_names
from armtrue.foreign.parts import Part, point_axis
from armtrue.foreign.polar import from_polar
from armtrue.foreign.sheets import SEPARATORS, Sheet, read_sheet
from armtrue.io import Dataset, Robot, load_data, load_model, load_robot
from armtrue.io.catalogue import with_role
from armtrue.io.columns import POSITION, QUATERNION, TEXT_COLUMNS
from armtrue.io.files import check_writable, read_text, refuse_to_lose, write_file
from armtrue.io.model import EXPRESSION_WORDS
from armtrue.units import plural

_SAME_POSE = 1e-6
_ROWS = 200
_NUMBER_OF_JOINT = re.compile(r"(?:q|qr|dir|tau|travel|duty)(\d+)")
_DH = {
    "dh": "standard (a, alpha after the rotation)",
    "mdh": "modified (Craig: before the rotation)",
}
_NAMES = ("robot.yaml", "dataset.yaml", "model.yaml", "data.csv")


@dataclass
class Guessed:
    """`written`: the files; `notes`: each guess and its reason; `findings`: of the checks on the result."""

    written: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)


def init(
    files: list[Path],
    out: Path,
    *,
    urdf: Path | None = None,
    dh: Path | None = None,
    robot: Path | None = None,
    model: Path | None = None,
    force: bool = False,
    skip_bad: bool = False,
) -> Guessed:
    """Read foreign measurement `files` and write the files that `check` and `fit` read into the folder `out`.

    `urdf`, `dh`, `robot`: the arm as a URDF, a table of DH rows, or a robot.yaml that is there already. `model`: a
    model.yaml that is there already; default: base, tool and the arm's geometry. `force`: replace files of an earlier
    run. `skip_bad`: leave out rows that cannot be read.

    Errors: InputError where a file or the arm cannot be read; nothing is then written.
    """
    targets = [out / name for name in _NAMES]
    refuse_to_lose([*files, urdf, dh, robot, model], targets)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out: found '{out}', expected a folder")
    for target in targets:
        kept = target.name == "robot.yaml" and not (urdf or dh)
        if target.exists() and not force and not kept:
            raise InputError(
                f"{target}: found the file already, expected a new folder (or --force, which replaces it)"
            )
    own = out / "robot.yaml"
    try:
        return _Init(files, out, model).run(urdf, dh, robot or (own if own.is_file() else None), skip_bad)
    except RowError as error:
        if skip_bad:
            raise InputError(f"{error}, as in most of the rows") from None
        raise InputError(f"{error}; --skip-bad reads the other rows") from None


class _Init:
    def __init__(self, files: list[Path], out: Path, model: Path | None) -> None:
        self._out = out
        self._model = model
        self._guessed = Guessed()
        self._sheets: list[Sheet] = []
        self._changes: list[list[str]] = []  # of each sheet, before its columns are read
        for file in files:
            joined, note = join_date_and_time(read_sheet(file))
            sheet, more = from_polar(joined)
            self._sheets.append(sheet)
            self._changes.append([words for words in (sheet.note, note, more) if words])

    def run(self, urdf: Path | None, dh: Path | None, robot: Path | None, skip_bad: bool) -> Guessed:
        robot_texts, names, prismatic, motors = self._arm(urdf, dh, robot)
        parts = [Part(sheet, meaning(sheet, _names_in(sheet, names, motors))) for sheet in self._sheets]
        for part, changes in zip(parts, self._changes, strict=True):
            part.notes += changes
            part.meaning.carry(len(names))
            _fit_to_arm(part, len(names), motors)
            if part.sheet.thousands:
                part.notes.append("thousands separators are removed")
            part.leave_out_dead_sensors()
            if skip_bad:
                part.leave_out_bad_rows()
            codes_of_words(part)
            _rename_taken(part)
            find_geometry_units(part, prismatic)
            find_clock(part)
        leave_out_own_poses(parts, self._arms(robot_texts, robot))
        _leave_out_row_names(parts)
        for part in parts:
            find_units(part)
            self._guessed.notes += [f"{part.sheet.path.name}: {note}" for note in part.notes]
        dataset, data_text = self._dataset(parts)
        made = not self._out.exists()
        self._out.mkdir(parents=True, exist_ok=True)
        try:
            self._write(robot_texts, robot, dataset, data_text)
        except BaseException:
            for path in self._guessed.written:
                path.unlink(missing_ok=True)
            if made:
                self._out.rmdir()
            raise
        return self._guessed

    def _arm(
        self, urdf: Path | None, dh: Path | None, robot: Path | None
    ) -> tuple[list[tuple[str, str]], list[str], set[str], list[int]]:
        """Texts of robot.yaml to choose from, each with a description, and properties of the joints.

        These are their names, the prismatic ones, and those with a motor (empty: all).
        """
        if urdf is not None:
            arm_of_urdf = robots.urdf_arm(urdf, self._out, self._joint_counts())
            self._guessed.notes.append(arm_of_urdf.words)
            text = _yaml({"name": urdf.stem, "kinematics": arm_of_urdf.kinematics})
            return [(text, "")], arm_of_urdf.names, arm_of_urdf.prismatic, arm_of_urdf.motors
        if dh is not None:
            rows, notes = robots.dh_rows(dh)
            self._guessed.notes += notes
            forms = [
                (
                    _yaml({"name": dh.stem, "kinematics": {"convention": own, "joints": rows}}),
                    f"{dh.name}: Denavit-Hartenberg, {words}",
                )
                for own, words in _DH.items()
            ]
            slide = {str(k) for k, row in enumerate(rows, start=1) if row.get("type") == "prismatic"}
            return forms, [], slide, []
        if robot is None:
            raise InputError(
                "init: found no arm, expected --urdf FILE, --dh TABLE (columns a, alpha, d, theta) or "
                "--robot robot.yaml; " + robots.WHERE_ARMS_ARE
            )
        arm = load_robot(robot)
        prismatic = {str(k) for k, joint in enumerate(arm.joints, start=1) if joint["type"] == "prismatic"}
        return [], [joint["name"] for joint in arm.joints], prismatic, arm.motors

    def _arms(self, robot_texts: list[tuple[str, str]], robot: Path | None) -> list[Robot]:
        """The arm in each possible form. Forms that cannot be read are skipped: `_write` reports them."""
        if robot is not None and not robot_texts:
            return [load_robot(robot)]
        arms = []
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.yaml"
            for text, _ in robot_texts:
                spec = yaml.safe_load(text)
                if "urdf" in spec["kinematics"]:
                    spec["kinematics"]["urdf"] = str((self._out / spec["kinematics"]["urdf"]).resolve())
                path.write_text(_yaml(spec))
                with contextlib.suppress(InputError):
                    arms.append(load_robot(path))
        return arms

    def _joint_counts(self) -> list[int]:
        """Possible numbers of joints in the files, the likelier first: with and without the axes that carry the arm."""
        first = next((m for sheet in self._sheets if (m := meaning(sheet, [])).joints), None)
        if first is None:
            return []
        own = sum(not name.startswith("qr") for name in first.joints)
        return [own + len(first.externals), own] if first.externals else [own]

    def _dataset(self, parts: list[Part]) -> tuple[dict[str, Any], str | None]:
        """dataset.yaml as a mapping without a rotation, and the text of data.csv where the files must be joined."""
        part = parts[0]
        whole = len(part.meaning.points) == 1 and part.meaning.joints
        if len(parts) > 1 or not whole or not part.sheet.direct:
            return self._joined(parts)
        if header := part.meaning.others.get("target"):
            self._guessed.notes.append(f"{part.sheet.path.name}: {header}: target, by its header")
        return _direct(part, self._out), None

    def _joined(self, parts: list[Part]) -> tuple[dict[str, Any], str]:
        long, notes = long_table(parts)
        table, labels = long.columns, long.labels
        self._guessed.notes += notes
        commanded = sorted(name for name in table if name[0] == "q" and name[1:].isdigit())
        rounded = np.round(np.column_stack([long.in_si(name) for name in commanded]) / _SAME_POSE)
        codes = np.unique(labels, return_inverse=True)[1] if labels else np.zeros(len(rounded))
        poses, which = np.unique(np.column_stack([rounded, codes]), axis=0, return_inverse=True)
        again = len(rounded) - len(poses)
        if again and "repeat" not in table:
            table["repeat"] = which.reshape(-1).astype(np.float64)
            repeat = "repeats" if again == 1 else "repeat"
            self._guessed.notes.append(f"{plural(again, 'row')} {repeat} a pose: column repeat")
        variables = {name: name for part in parts for name in part.meaning.variables if name in table}
        own = [name for name in table if name not in variables]
        entries: dict[str, Any] = {name: _entry(name, long.units.get(name)) for name in own}
        if labels:
            entries["target"] = "target"
        dataset: dict[str, Any] = {"file": "data.csv", "columns": entries}
        if variables:
            dataset["variables"] = variables
        turned = [part for part in parts if part.meaning.rotation]
        if not labels and len(turned) == 1 and len(turned[0].sheet.rows) == len(rounded):
            headers = {f"rotation_{k}": name for k, name in enumerate(turned[0].meaning.rotation, start=1)}
            table |= {name: turned[0].numbers(header) for name, header in headers.items()}
            dataset["rotation"] = _rotation([*headers], turned[0])
        else:
            why = "orientations are not taken, as they are read of one reflector in one file only"
            for part in turned:
                headers_of_part = ", ".join(part.meaning.rotation)
                self._guessed.notes.append(f"{part.sheet.path.name}: {headers_of_part}: {why}")
        if "time" in table and bool(np.any(np.diff(table["time"]) < 0.0)):
            dataset["sort_by"] = "time"
        return dataset, write_long(long)

    def _write(
        self,
        robot_texts: list[tuple[str, str]],
        robot: Path | None,
        dataset: dict[str, Any],
        data: str | None,
    ) -> None:
        out, written = self._out, self._guessed.written

        def put(name: str, text: str) -> Path:
            check_writable(out / name)
            if out / name not in written:
                written.append(out / name)
            write_file(out / name, text)
            return out / name

        if data is not None:
            put("data.csv", data)
        geometry = _yaml({"effects": with_role("placement", "geometry")})
        put("model.yaml", read_text(self._model) if self._model else geometry)
        rotation = dataset.pop("rotation", None)
        put("dataset.yaml", _yaml(dataset))
        if robot is not None and not robot_texts:
            if robot.resolve() != (out / "robot.yaml").resolve():
                put("robot.yaml", _moved(robot, out))
        else:
            text, words = min(robot_texts, key=lambda choice: self._rms(put("robot.yaml", choice[0])))
            put("robot.yaml", text)
            self._guessed.notes += [words] if words else []
        arm = load_robot(out / "robot.yaml")
        if rotation is not None:
            found = self._found_rotation(rotation, dataset, arm, put)
            put("dataset.yaml", _yaml({**dataset, "rotation": found} if found else dataset))
        measurements = load_data(out / "dataset.yaml", arm, strict=False)
        self._guessed.notes += measurements.notes
        if self._model:
            load_model(self._model, arm, measurements.columns)
        else:
            self._guessed.notes.append("model.yaml: base, tool and geometry alone (--model takes another)")
        self._guessed.findings = cheap_findings(measurements, arm)
        comment = "".join(f"# {note}\n" for note in self._guessed.notes)
        put("dataset.yaml", comment + (out / "dataset.yaml").read_text())

    def _rms(self, robot: Path) -> float:
        arm = load_robot(robot)
        columns = alignment_columns(load_data(self._out / "dataset.yaml", arm, strict=False))
        return align(thinned(columns, _ROWS), arm).rms_m

    def _found_rotation(self, rotation: dict[str, Any], dataset: dict[str, Any], arm: Robot, put: Any) -> Any:
        """`rotation` in the convention under which orientations follow the arm; None if there is none."""
        put("dataset.yaml", _yaml({**dataset, "rotation": rotation}))
        data: Dataset = load_data(self._out / "dataset.yaml", arm, strict=False)
        found = rotation_that_follows(data, arm, rotation)
        names = ", ".join(rotation["columns"])
        if found is None:
            self._guessed.notes.append(
                f"{names}: orientations follow the arm in no convention tried, not used"
            )
            return None
        keys, degrees = found
        words = " ".join(str(value) for key, value in keys.items() if key != "columns")
        self._guessed.notes.append(f"{names}: {words}, as they then follow the arm within {degrees:.2g}°")
        return keys


def _names_in(sheet: Sheet, names: list[str], motors: list[int]) -> list[str]:
    """The arm's joint names that a sheet may use: all of them, or those with a motor if it lacks some."""
    words = {name.lower() for name in sheet.header}
    if all(name.lower() in words for name in names):
        return names
    return [names[k - 1] for k in motors] or names


def _fit_to_arm(part: Part, joint_count: int, motors: list[int]) -> None:
    """Leave out joints beyond the arm's `joint_count` (0: unknown). Errors: InputError if there are too few.

    If the file numbers only the joints with a motor, its joints get the arm's numbers.
    """
    found = part.meaning
    own = [header for name, header in found.joints.items() if not name.startswith("qr")]
    if not own or not joint_count:
        return
    if len(motors) <= len(own) < joint_count and motors:
        number_of = {str(place): str(motor) for place, motor in enumerate(motors, start=1)}
        for columns in (found.joints, found.others):
            numbered = [(name, header, _NUMBER_OF_JOINT.fullmatch(name)) for name, header in columns.items()]
            columns.clear()
            for name, header, match in numbered:
                if match is None:
                    columns[name] = header
                elif match[1] in number_of:
                    columns[name.removesuffix(match[1]) + number_of[match[1]]] = header
        numbers = ", ".join(map(str, motors))
        part.notes.append(f"{', '.join(own)} are taken for joints {numbers}, which have a motor")
        return
    if len(own) < joint_count:
        raise InputError(
            f"{part.sheet.path} header: found {plural(len(own), 'joint')} ({', '.join(own)}), expected {joint_count}, "
            "as the arm has (headers such as q1, J1, A1, joint_1, or the names of the arm's joints)"
        )
    for columns in (found.joints, found.others):
        for name, header in list(columns.items()):
            number = _NUMBER_OF_JOINT.fullmatch(name)
            if number and int(number[1]) > joint_count:
                del columns[name]
                found.left[header] = f"the arm has {plural(joint_count, 'joint')}"


def _leave_out_row_names(parts: list[Part]) -> None:
    """Take the columns that name the rows of two files for that alone, and not as variables."""
    for joints in (part for part in parts if part.meaning.joints):
        for points in (part for part in parts if part is not joints and part.meaning.points):
            for part, header in zip((joints, points), row_names(joints, points) or (), strict=False):
                found = part.meaning
                found.variables = {own: name for own, name in found.variables.items() if name != header}
                if header != found.key:
                    found.left[header] = "it names rows, which is used to match files"


def _rename_taken(part: Part) -> None:
    """Rename variables whose names are functions, state variables or columns of the contract."""
    sensors = [name.removeprefix("temp_") for name in part.meaning.others if name.startswith("temp_")]
    state = json.loads(_core.state_variables(len(part.meaning.joints) or 6, sensors))
    taken = {*EXPRESSION_WORDS, *POSITION, *QUATERNION, *part.meaning.others, *part.meaning.joints}
    taken |= {*TEXT_COLUMNS, "payload", "time", *(variable["name"] for variable in state)}
    variables = part.meaning.variables
    part.meaning.variables = {f"own_{name}" if name in taken else name: variables[name] for name in variables}


def _entry(header: str, unit: str | None) -> Any:
    """The entry of a column in dataset.yaml."""
    return {"column": header, "unit": unit} if unit not in (None, "m", "rad", "s", "degC") else header


def _direct(part: Part, out: Path) -> dict[str, Any]:
    """dataset.yaml for one file that is read as it is, with a first guess of the rotation's convention."""
    sheet, found = part.sheet, part.meaning
    ((point, axes),) = found.points.items()
    units = {**part.units, **{axis: part.units.get(point_axis(point, axis)) for axis in "xyz"}}
    named = {**found.joints, **dict(zip("xyz", axes, strict=True)), **found.others}
    columns: dict[str, Any] = {name: _entry(header, units.get(name)) for name, header in named.items()}
    dataset: dict[str, Any] = {"file": os.path.relpath(sheet.path.resolve(), out.resolve())}
    if sheet.separator != ",":
        dataset["separator"] = SEPARATORS[sheet.separator]
    if sheet.decimal != ".":
        dataset["decimal"] = sheet.decimal
    if sheet.encoding != "utf-8":
        dataset["encoding"] = sheet.encoding
    if sheet.header_row != 1:
        dataset["header_row"] = sheet.header_row
    if part.clock is not None:
        header = found.others["time"]
        place, entry = part.clock.entry(sheet, header)
        if place == "time":
            del columns["time"]
            dataset["time"] = entry
        else:
            columns["time"] = entry
    if found.rotation:
        dataset["rotation"] = _rotation(found.rotation, part)
    if found.variables:
        dataset["variables"] = dict(found.variables)
    if part.skipped:
        dataset["rows"] = {"skip": sorted(part.skipped)}
    return {**dataset, "columns": columns}


def _rotation(headers: list[str], part: Part) -> dict[str, Any]:
    if len(headers) == 9:
        return {"form": "matrix", "columns": headers}
    if len(headers) == 4:
        return {"form": "quaternion", "columns": headers, "order": "wxyz"}
    unit = part.units.get("rotation", "rad")
    return {"form": "euler", "columns": headers, "sequence": "XYZ", "axes": "intrinsic", "unit": unit}


def _moved(robot: Path, out: Path) -> str:
    """The text of `robot` for the folder `out`, with the path of its URDF relative to that folder."""
    text = robot.read_text(encoding="utf-8-sig")
    spec = yaml.safe_load(text)
    urdf = spec.get("kinematics", {}).get("urdf") if isinstance(spec, dict) else None
    if urdf is None:
        return text
    spec["kinematics"]["urdf"] = os.path.relpath((robot.parent / urdf).resolve(), out.resolve())
    return _yaml(spec)


def _yaml(value: dict[str, Any]) -> str:
    return str(yaml.safe_dump(value, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110))
