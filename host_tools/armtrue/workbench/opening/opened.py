"""From the files that the user names to a first model."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from armtrue.checking import refuse_what_cannot_be_an_arm
from armtrue.errors import InputError
from armtrue.fitting import Fit, fit
from armtrue.io import Dataset, Model, Robot, load_data, load_model, load_robot
from armtrue.io.catalogue import with_role
from armtrue.io.plausible import refuse_too_few_poses
from armtrue.progress import Progress
from armtrue.report.gathered.steps import check_same_data


@dataclass
class Opened:
    """What was opened: measurements with an arm and a model to fit, or fits that were made before.

    `files`: all that were read; they identify the session. `notes`: sentences on what was used without being named.
    """

    data: Dataset
    robot: Robot
    model: Model | None
    fits: list[Fit]
    files: list[Path]
    notes: list[str] = field(default_factory=list)

    def first_fits(self, progress: Progress | None = None) -> list[Fit]:
        """The fits that the session begins with."""
        if self.fits:
            return self.fits
        assert self.model is not None
        return [fit(self.data, self.robot, self.model, progress=progress)]


def open_files(files: list[Path], robot: Path | None = None, model: Path | None = None) -> Opened:
    """Read measurements or fits. Errors: InputError that names the file and what was expected."""
    if not files:
        raise InputError("open: found no file, expected measurements (CSV, dataset.yaml) or a fit.json")
    if missing := [file for file in files if not file.exists()]:
        raise InputError(f"{missing[0]}: cannot be read (there is no such file)")
    fits = [file for file in files if file.suffix.lower() == ".json"]
    others = [file for file in files if file not in fits]
    if fits and (others or robot or model):
        wrong = (others + [path for path in (robot, model) if path])[0]
        raise InputError(
            f"{wrong}: found it beside {fits[0]}, expected fits alone: they know their arm and model"
        )
    if len(others) > 1:
        raise InputError(
            f"{others[1]}: found a second file of measurements, expected one; 'armtrue init' joins several"
        )
    return _of_fits(fits) if fits else _of_measurements(others[0], robot, model)


def _of_fits(paths: list[Path]) -> Opened:
    fits = [Fit.load(path) for path in paths]
    for path, each in zip(paths, fits, strict=True):
        each.path = path.resolve()
    check_same_data(fits)
    data = fits[0].data
    return Opened(data, fits[0].robot, None, fits, [*paths, *_files_of(data)])


def _of_measurements(path: Path, robot: Path | None, model: Path | None) -> Opened:
    notes: list[str] = []
    robot = robot or _beside(path, "robot", notes)
    if robot is None:
        raise InputError(
            f"{path}: found no arm, expected --robot ROBOT or robot.yaml beside the measurements"
        )
    arm = load_robot(robot)
    data = load_data(path, arm)
    model = model or _beside(path, "model", notes)
    if model is None:
        # As `armtrue init` writes it: the geometry alone; the diagnosis then recommends further effects.
        believed = Model([{"effect": name} for name in with_role("placement", "geometry")])
        notes.append("no model was named: the geometry of the arm is fitted first")
    else:
        believed = load_model(model, arm, data.columns)
    refuse_too_few_poses(data.file, data.joints)
    doubts = refuse_what_cannot_be_an_arm(data, arm)
    read = [robot, *([model] if model else []), *_files_of(data)]
    return Opened(data, arm, believed, [], read, [*notes, *data.notes, *doubts])


def _files_of(data: Dataset) -> list[Path]:
    return list(dict.fromkeys([data.path, data.file]))


def _beside(path: Path, kind: str, notes: list[str]) -> Path | None:
    place = path.with_name(f"{kind}.yaml")
    if not place.is_file():
        return None
    notes.append(f"{kind}: {place.name} beside the measurements is taken")
    return place
