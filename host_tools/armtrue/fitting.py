"""Fit a model to measurements, keep it in fit.json, predict with it. `armtrue._core` computes the numbers."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue import _core, notebook
from armtrue.errors import InputError
from armtrue.extrapolation import Beyond, is_joint, margin, ranges_of
from armtrue.fit_file import at_average, check_document, not_for_a_device, own_columns_read
from armtrue.io import Dataset, Model, Robot, load_data
from armtrue.io.columns import FAR_TRAVEL, TRAVEL, commanded_joints
from armtrue.io.files import read_json, write_file
from armtrue.io.model import check_effect, refusal_words
from armtrue.io.plausible import refuse_too_few_poses
from armtrue.progress import Progress
from armtrue.springs import warnings_of_springs

FORMAT = "armtrue-fit"
VERSION = 1
_LARGEST_FIT_BYTES = 512 * 1024 * 1024


class _EffectError(InputError):
    """An effect that the arm or its measurements do not allow; names no file: the caller knows where it came from."""


@dataclass
class Fit:
    """A fitted model.

    `document` is what fit.json holds (docs/model.md, section fit.json). The measurements are read from their file when
    first needed, and refused if they have changed since the fit.
    """

    document: dict[str, Any]
    path: Path | None = None
    _data: Dataset | None = field(default=None, repr=False)
    _core_fit: _core.Fit | None = field(default=None, repr=False)
    # The library's fit has scratch memory, so that only one thread at a time may call it.
    lock: threading.RLock = field(default_factory=threading.RLock, init=False, repr=False, compare=False)
    _arrays: dict[str, NDArray[np.float64]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __repr__(self) -> str:
        return notebook.fit_text(self.document)

    def _repr_html_(self) -> str:
        return notebook.fit_html(self.document)

    @classmethod
    def load(cls, path: str | Path) -> Fit:
        """Read a fit.json. Errors: InputError where it is no fit or of another version."""
        path = Path(path)
        document = read_json(path, _LARGEST_FIT_BYTES, "a fit.json")
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            raise InputError(f"{path}: found no 'format: {FORMAT}', expected a file written by armtrue fit")
        if document.get("version") != VERSION:
            raise InputError(f"{path}: found version {document.get('version')}, expected {VERSION}")
        check_document(document, path)
        return cls(document, path)

    def save(self, path: str | Path) -> None:
        """Write fit.json beside `path` and rename it there, so that a killed run leaves the old one."""
        write_file(Path(path), json.dumps(self.document, indent=1) + "\n")
        self.path = Path(path)

    @property
    def robot(self) -> Robot:
        """The nominal arm."""
        return Robot(self.document["robot"])

    @property
    def effects(self) -> list[dict[str, Any]]:
        """The effects in the model, normalised."""
        return list(self.document["model"]["effects"])

    @property
    def data(self) -> Dataset:
        """The measurements that were fitted.

        Errors: InputError that says where they were looked for, or that they have changed.
        """
        if self._data is None:
            skip_bad = bool(self.document["data"].get("skipped"))
            read = load_data(self._data_path(), self.robot, skip_bad=skip_bad)
            self._data = read.without(self.document["data"].get("left_out", []))
            if fingerprint(self._data) != self.document["data"]["sha256"]:
                raise InputError(
                    f"{self._data.path}: found other measurements than those of the fit, expected them unchanged"
                )
        return self._data

    @property
    def core(self) -> _core.Fit:
        """The fitted model in the numerical library, solved again where the fit was loaded from a file."""
        with self.lock:
            if self._core_fit is None:
                self._core_fit = _run(
                    self.data, self.robot, self.document["model"], self.document["options"], None
                )
            return self._core_fit

    @property
    def searched(self) -> list[str]:
        """Names of the effects that a search added; a later search may remove them, unlike those of the user."""
        return list(self.document.get("searched", []))

    def predict(self, data: Dataset) -> NDArray[np.float64]:
        """Predicted positions (N, 3) [m] in the measuring frame. Errors: InputError where a column is missing."""
        columns = self.columns_for(data)
        with refusals_about(data):
            return np.asarray(_core.predict(self._for_the_library(), columns))

    def columns_for(self, data: Dataset) -> dict[str, NDArray[np.float64]]:
        """Columns of `data` from which the library predicts, with reflectors numbered as in this fit.

        Errors: InputError where a column is missing, or a reflector is none of the fit's.
        """
        columns = {**data.columns, **self.assumed(data)[0]}
        names = self.document["data"].get("targets", [])
        if columns.pop("target", None) is not None and names:
            columns["target"] = data.reflectors_among(names, "the fit's").astype(np.float64)
        return columns

    def assumed(self, data: Dataset) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
        """Substitutes for columns that poses not driven yet cannot have, and notes on what `predict` assumes.

        Errors: InputError that names a column without which there is no prediction.
        """
        read = self.document.get("columns", {})
        lacking = {name: instead for name, instead in read.items() if name not in data.columns}
        unknown = [name for name in lacking if TRAVEL.fullmatch(name)]
        for name, instead in lacking.items():
            if not instead and name not in unknown:
                raise InputError(
                    f"{data.path}: column {name} is missing or not recorded, expected it as {self.path or 'the fit'} "
                    "reads it"
                )
        settled = {name: data.columns[instead] for name, instead in lacking.items() if instead}
        missing = settled | {name: np.full(data.count, FAR_TRAVEL) for name in unknown}
        notes, file = [], data.path.name
        if settled:
            notes.append(f"{file} has no {', '.join(settled)}: the joints are assumed to have settled")
        if unknown:
            notes.append(
                f"{file} has no {', '.join(unknown)}: a long travel since the last reversal is assumed"
            )
        reflectors = self.document["data"].get("targets", [])
        if len(reflectors) > 1 and "target" not in data.columns:
            notes.append(
                f"{file} has no column target: all rows are assumed to be of '{reflectors[0]}', the first "
                f"of the fit's reflectors {', '.join(reflectors)}; if they are of another, name it in a column target"
            )
        return missing, [*notes, *self.extrapolated(data)]

    def beyond(self, data: Dataset) -> list[Beyond]:
        """The columns of `data` outside their fitted ranges, joints first, each group from the farthest.

        Joints and columns that a term of this fit reads count, as far as fit.json has their ranges.
        """
        read = self.document.get("columns", {})
        found = []
        for name, (lo, hi) in self.document["data"].get("ranges", {}).items():
            if name not in data.columns or not (is_joint(name) or name in read):
                continue
            apart = np.maximum(lo - data.columns[name], data.columns[name] - hi)
            rows = apart > margin(name, lo, hi)
            if rows.any():
                effects = [] if is_joint(name) else _effects_that_read(name, self.document["parameters"])
                found.append(Beyond(name, rows, float(apart.max()), hi - lo, effects))
        return sorted(found, key=lambda one: (not is_joint(one.name), -one.amount))

    def extrapolated(self, data: Dataset, of_the_arm: bool = False) -> list[str]:
        """A note where poses of `data` lie outside the fitted ranges, as far as fit.json has these.

        `of_the_arm`: only joints and columns that exported effects of the arm read, as tables hold no others.
        """
        beyond = self.beyond(data)
        if of_the_arm:
            left_out = not_for_a_device(self.document)
            exported = [p for p in self.document["parameters"] if p.get("exported", True)]
            in_tables = [p for p in exported if p["name"] not in left_out]
            beyond = [one for one in beyond if not one.effects or _effects_that_read(one.name, in_tables)]
        if not beyond:
            return []
        outside = np.any([one.rows for one in beyond], axis=0)
        return [
            f"{int(outside.sum())} of {data.count} poses of {data.path.name} lie outside what was fitted "
            f"({', '.join(one.words(self.robot) for one in beyond)}): figures there are extrapolated"
        ]

    def residuals(self) -> NDArray[np.float64]:
        """Measured minus predicted positions (N, 3) [m] of the fitted measurements."""
        return self._kept("residuals", lambda core: core.residuals())

    def state_column(self, name: str) -> NDArray[np.float64]:
        """A state variable of docs/model.md over the fitted rows (N,). Errors: _core.ModelError where there is none."""
        return self._kept(f"state {name}", lambda core: _core.state_column(core, name)[:, 0])

    def coordinate_column(self, name: str) -> NDArray[np.float64]:
        """Change of every predicted position by one coordinate [m per unit], (N, 3)."""
        return self._kept(f"coordinate {name}", lambda core: _core.coordinate_column(core, name))

    def residuals_in_noise(self) -> NDArray[np.float64]:
        """Measured minus predicted in standard deviations: (N, 3), or (N, 6) where orientations were measured."""
        return self._kept("in noise", lambda core: _core.residuals_in_noise(core, core))

    def turns(self) -> NDArray[np.float64] | None:
        """Measured relative to predicted orientations (N, 3) as rotation vectors [rad]; None if none were measured."""
        sigma = self.document["noise"]["sigma_rotation_rad"]
        return None if sigma is None else np.asarray(sigma * self.residuals_in_noise()[:, 3:])

    def orientation_error(self) -> dict[str, float] | None:
        """Angles [rad] between measured and predicted orientations of the fitted rows: `mean`, `rms`, `p95`, `max`."""
        turns = self.turns()
        if turns is None:
            return None
        rejected = [int(entry["index"]) for entry in self.document["rejected"]]
        angle = np.linalg.norm(np.delete(turns, rejected, axis=0), axis=1)
        return {
            "mean": float(angle.mean()),
            "rms": float(np.sqrt(np.mean(angle**2))),
            "p95": float(np.percentile(angle, 95.0)),
            "max": float(angle.max()),
        }

    def _kept(self, name: str, work: Callable[[_core.Fit], Any]) -> NDArray[np.float64]:
        """An array of the library, cached because charts ask for the same ones repeatedly."""
        if name not in self._arrays:
            with self.lock:
                self._arrays[name] = np.asarray(work(self.core))
        return self._arrays[name]

    def _for_the_library(self) -> str:
        """The document as JSON text for `_core.predict`, which numbers reflectors in the order of their sorted keys."""
        names = self.document["data"].get("targets", [])
        if len(names) < 2:
            return json.dumps(self.document)
        tools = self.document["flange_from_tool"]
        in_order = {f"{code:04d}": tools[name] for code, name in enumerate(names)}
        return json.dumps({**self.document, "flange_from_tool": in_order})

    def _data_path(self) -> Path:
        recorded = self.document["data"]
        places = [Path(recorded["path"])]
        if self.path is not None:
            places += [self.path.parent / recorded["relative"], self.path.parent / places[0].name]
        for place in places:
            if place.is_file():
                return place
        looked = ", ".join(str(place) for place in dict.fromkeys(places))
        raise InputError(f"{self.path or 'fit'}: its measurements are gone; looked for them at {looked}")


def _effects_that_read(name: str, parameters: list[dict[str, Any]]) -> list[str]:
    """The effects of `parameters` whose terms name a column; effects that read it only through a load are not found."""
    variable = re.compile(rf"\b(?:d?T_|temp_)?{re.escape(name.removeprefix('temp_'))}\b")
    terms = ((p["effect"], term["expression"]) for p in parameters for term in p.get("terms", []))
    return list(dict.fromkeys(effect for effect, expression in terms if variable.search(expression)))


def fit(
    data: Dataset,
    robot: Robot,
    model: Model,
    *,
    folds: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
) -> Fit:
    """Fit `model` to `data`.

    `folds`, `seed`: of the cross-validation. Errors: InputError where the arm or the data do not allow the model.
    """
    if not 2 <= folds <= 100:
        raise InputError(f"--folds: found {folds}, expected 2 to 100")
    specification = {"effects": model.effects, "parameters": model.parameters, "priors": model.priors}
    options: dict[str, Any] = {"folds": folds, "seed": seed, "instrument": model.instrument}
    origin = f"{model.path or 'model'} on {data.path}"
    return _fitted(data, robot, specification, options, progress, origin)


def add(
    base: Fit,
    effect: str,
    joints: list[int] | None = None,
    options: dict[str, Any] | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Return `base` with one more effect, fitted again. Errors: InputError where it is present or not allowed."""
    entry: dict[str, Any] = {"effect": effect, **(options or {})}
    if joints:
        entry["joints"] = joints
    checked = check_effect(entry, base.robot, "add", base.effects, base.data.columns)
    return with_effects(base, [*base.effects, checked], progress)


def with_effects(base: Fit, effects: list[dict[str, Any]], progress: Progress | None = None) -> Fit:
    """Return `base` with other effects, fitted again to the same measurements."""
    specification, options = {**base.document["model"], "effects": effects}, base.document["options"]
    fit = _fitted(base.data, base.robot, specification, options, progress, str(base.data.path))
    fit.document["searched"] = base.searched
    return fit


def effect_terms(base: Fit, entry: dict[str, Any], columns: dict[str, NDArray[np.float64]]) -> dict[str, Any]:
    """The terms that an effect would add to `base`, evaluated on `columns`: what `_core.effect_terms` gives.

    `entry`: effect, joints and options. Errors: _core.ModelError where the arm cannot have it.
    """
    request = {key: entry[key] for key in ("effect", "joints", "options") if entry.get(key)}
    robot = _robot_json(base.robot, base.data)
    return dict(json.loads(_core.effect_terms(robot, columns, json.dumps(request))))


def fingerprint(data: Dataset) -> str:
    """SHA-256 over the columns of `data`: changes with the measurements, but not with their file format."""
    digest = hashlib.sha256()
    for name in sorted(data.columns):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(data.columns[name]).tobytes())
    return digest.hexdigest()


def _run(
    data: Dataset,
    robot: Robot,
    specification: dict[str, Any],
    options: dict[str, Any],
    progress: Progress | None,
) -> _core.Fit:
    texts = json.dumps(specification), json.dumps(options)
    with refusals_about(data):
        try:
            return _core.fit(_robot_json(robot, data), data.columns, *texts, progress)
        except _core.ModelError as error:
            if not str(error).startswith(("effect ", "model: ")):
                raise
            names = _parameter_names(data, robot, specification["effects"])
            raise _EffectError(
                refusal_words(str(error), specification["effects"], names, data.rows)
            ) from None


def _parameter_names(data: Dataset, robot: Robot, effects: list[dict[str, Any]]) -> list[str]:
    """The names of all parameters of `effects` on this arm; effects that it cannot have are skipped."""
    names: list[str] = []
    for entry in effects:
        options = {key: value for key, value in entry.items() if key not in ("effect", "joints")}
        request = {"effect": entry["effect"], "joints": entry.get("joints", []), "options": options}
        with suppress(_core.ModelError):
            terms = _core.effect_terms(_robot_json(robot, data), data.columns, json.dumps(request))
            names += [parameter["name"] for parameter in json.loads(terms)["parameters"]]
    return names


@contextmanager
def refusals_about(data: Dataset) -> Iterator[None]:
    """Turn a ModelError of the numerical library into an InputError that names the file of `data`."""
    try:
        yield
    except _core.ModelError as error:
        raise InputError(f"{data.path}: {error}") from None


def _robot_json(robot: Robot, data: Dataset) -> str:
    """Return the arm for the numerical library, which knows reflectors by their code in `data`."""
    tools = robot.spec.get("tools")
    if not tools:
        return robot.json()
    names = data.labels.get("target", [])
    if not names:
        raise InputError(f"{data.path}: column 'target' is missing, expected it beside robot.yaml's tools")
    if unknown := [name for name in names if name not in tools]:
        raise InputError(
            f"{data.path} column target: found '{unknown[0]}', expected one of robot.yaml's tools {', '.join(tools)}"
        )
    return json.dumps({**robot.spec, "targets": [tools[name] for name in names]})


def _fitted(
    data: Dataset,
    robot: Robot,
    specification: dict[str, Any],
    options: dict[str, Any],
    progress: Progress | None,
    origin: str,
) -> Fit:
    """`origin`: where the effects come from, for a message that refuses one."""
    refuse_too_few_poses(data.file, data.joints)
    try:
        core = _run(data, robot, specification, options, progress)
    except _EffectError as error:
        raise InputError(f"{origin}: {error}") from None
    return _document(core, data, robot, specification, options)


def from_core(base: Fit, core: _core.Fit) -> Fit:
    """Return `core`, the library's fit to the measurements of `base`, as a Fit with its whole document."""
    specification = {**base.document["model"], "effects": json.loads(core.specification())["effects"]}
    fit = _document(core, base.data, base.robot, specification, base.document["options"])
    fit.document["searched"] = _core.searched_effects(base.core, core, set(base.searched))
    return fit


def _document(
    core: _core.Fit, data: Dataset, robot: Robot, specification: dict[str, Any], options: dict[str, Any]
) -> Fit:
    document = {
        "format": FORMAT,
        "version": VERSION,
        "robot": robot.spec,
        "model": specification,
        "options": options,
        "data": _data_entry(data),
        **json.loads(core.document()),
    }
    # Columns that only terms of the instrument read are needed for a prediction, too.
    own = sorted({column for read in own_columns_read(document).values() for column in read})
    document["columns"] |= dict.fromkeys(own, "")
    document["data"]["ranges"] |= ranges_of(data, ["time", *document["columns"]])
    for rejected in document["rejected"]:
        rejected["row"] = int(data.rows[rejected["index"]])
    targets = data.labels.get("target", [])
    if len(targets) > 1:
        tools = document["flange_from_tool"]
        document["flange_from_tool"] = {name: tools[str(code)] for code, name in enumerate(targets)}
    document["warnings"] += warnings_of_springs(document, robot)
    fit = Fit(document, None, data, core)
    left_out = not_for_a_device(document)
    if left_out:
        means = {name: float(data.columns[name].mean()) for name in ("time", *own) if name in data.columns}
        if "time" in means:
            means["time"] -= document.get("time_origin_s", 0.0)
        document["data"]["means"] = means
        document["effects_move_um"] |= {name: _varies_um(fit, name) for name in left_out}
    return fit


def _varies_um(fit: Fit, parameter: str) -> float:
    """RMS distance [µm] of the fitted rows' predictions from those with the inputs of `parameter` at their averages."""
    means, fitted = fit.document["data"]["means"], fit.document["parameters"]
    parameters = [at_average(entry, means) if entry["name"] == parameter else entry for entry in fitted]
    apart = fit.predict(fit.data) - Fit({**fit.document, "parameters": parameters}).predict(fit.data)
    return float(1e6 * np.sqrt((apart**2).sum(axis=1).mean()))


def _data_entry(data: Dataset) -> dict[str, Any]:
    return {
        "path": str(data.path.resolve()),
        "relative": data.path.name,
        "sha256": fingerprint(data),
        "rows": data.count,
        "columns": sorted(data.columns),
        "ranges": ranges_of(data, commanded_joints(data.columns)),
        "targets": data.labels.get("target", []),
        "skipped": [{"row": row, "why": why} for row, why in sorted(data.skipped.items())],
        "left_out": data.left_out,
    }
