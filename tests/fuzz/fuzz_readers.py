"""Fuzz one reader of armtrue: whatever the bytes, it returns or raises InputError.

    python tests/fuzz/fuzz_readers.py TARGET [libFuzzer options] [corpus folders]

TARGET: csv, dataset, robot, urdf, model, expression, fit. Corpora and tokens lie beside this file.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["armtrue.io", "armtrue.errors", "yaml", "csv", "urdf_parser_py"]):
    from armtrue.errors import InputError
    from armtrue.io import Robot, load_data, load_model, load_robot

from armtrue.fitting import Fit

ROBOT = """\
kinematics:
  convention: mdh
  joints:
  - {name: A1, a: 0.0, alpha: 0.0, d: 0.4}
  - {name: A2, a: 0.1, alpha: -1.57, d: 0.0, type: prismatic}
temperature: {reference: 20.0, sensors: [arm]}
"""
CSV = "J1;J2;PX;PY;PZ;When;Who\n0,1;0,2;1,0;2,0;3,0;2020-07-14;a\n0,3;0,1;1,5;2,0;3,0;2020-07-15;b\n"
URDF_ROBOT = "kinematics: {urdf: arm.urdf, base: base, tip: tip}\n"

Target = Callable[[bytes], None]


def csv_target(folder: Path) -> Target:
    """Measurements in the contract's form."""
    robot = robot_in(folder)

    def run(data: bytes) -> None:
        (folder / "data.csv").write_bytes(data)
        load_data(folder / "data.csv", robot)

    return run


def dataset_target(folder: Path) -> Target:
    """A dataset.yaml over a fixed foreign CSV."""
    robot = robot_in(folder)
    (folder / "foreign.csv").write_text(CSV)

    def run(data: bytes) -> None:
        (folder / "dataset.yaml").write_bytes(data)
        load_data(folder / "dataset.yaml", robot)

    return run


def robot_target(folder: Path) -> Target:
    """A robot.yaml."""

    def run(data: bytes) -> None:
        (folder / "robot.yaml").write_bytes(data)
        load_robot(folder / "robot.yaml").json()

    return run


def urdf_target(folder: Path) -> Target:
    """A URDF under a fixed robot.yaml."""
    (folder / "robot.yaml").write_text(URDF_ROBOT)

    def run(data: bytes) -> None:
        (folder / "arm.urdf").write_bytes(data)
        load_robot(folder / "robot.yaml").json()

    return run


def model_target(folder: Path) -> Target:
    """A model.yaml for a fixed robot."""
    robot = robot_in(folder)

    def run(data: bytes) -> None:
        (folder / "model.yaml").write_bytes(data)
        load_model(folder / "model.yaml", robot)

    return run


def expression_target(folder: Path) -> Target:
    """A user's expression, inside a model.yaml."""
    robot = robot_in(folder)

    def run(data: bytes) -> None:
        text = data.decode("utf-8", "replace")
        entry = {
            "effect": "custom",
            "name": "mine",
            "coordinate": "motor1",
            "expression": text,
            "parameters": {"k": 1},
        }
        (folder / "model.yaml").write_text(json.dumps({"effects": [entry]}))
        load_model(folder / "model.yaml", robot)

    return run


def fit_target(folder: Path) -> Target:
    """A fit.json."""

    def run(data: bytes) -> None:
        (folder / "fit.json").write_bytes(data)
        Fit.load(folder / "fit.json")

    return run


def robot_in(folder: Path) -> Robot:
    """The fixed robot that the other files are for."""
    (folder / "arm.yaml").write_text(ROBOT)
    return load_robot(folder / "arm.yaml")


TARGETS: dict[str, Callable[[Path], Target]] = {
    "csv": csv_target,
    "dataset": dataset_target,
    "robot": robot_target,
    "urdf": urdf_target,
    "model": model_target,
    "expression": expression_target,
    "fit": fit_target,
}


def main() -> None:
    """Hand the chosen target to libFuzzer."""
    target = sys.argv.pop(1) if len(sys.argv) > 1 else ""
    if target not in TARGETS:
        sys.exit(f"fuzz_readers: found target '{target}', expected one of {', '.join(TARGETS)}")
    with tempfile.TemporaryDirectory() as folder:
        run = TARGETS[target](Path(folder))

        def one_input(data: bytes) -> None:
            try:
                run(data)
            except InputError as error:
                # The message is one line, whatever it quotes from the input, and is never empty.
                if not str(error) or "\n" in str(error):
                    raise AssertionError(f"not one sentence: {error!r}") from error

        atheris.Setup(sys.argv, one_input)
        atheris.Fuzz()


main()
