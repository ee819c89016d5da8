"""The whole story over CAN: measure, fit, diagnose, add, export, upload, measure again; and the judge."""

from __future__ import annotations

import csv
import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from armtrue_sim.build import build_arm, context_of, published_robot
from armtrue_sim.effects import default_joints
from armtrue_sim.scenario import Scenario

from armtrue_loop.controller import Controller
from armtrue_loop.figures import Errors, Figures, Step
from armtrue_loop.operator import Operator
from armtrue_loop.plans import Array, Plan, make_plans
from armtrue_loop.processes import CellProcess, NodeUnderTest
from armtrue_loop.session import Session, measure
from armtrue_loop.toolbox import Toolbox
from armtrue_loop.wiring import CONTROLLER_BUS, DRIVE_BUS, INCREMENTS_PER_TURN

BUS = ("--interface", "socketcan", "--channel", CONTROLLER_BUS)
# Effects that diagnosis may add before the story ends whatever is left.
MOST_ADDED = 5
# Lines of a tool's output that a newcomer is shown; the rest is in the folder.
_LINES_OF_FIT = 8
_LINES_OF_DIAGNOSE = 7


class Story:
    """One run, with `tools` made before there were threads.

    `chapter` and `say` print for people, `progress` tells how far a stage is.
    """

    def __init__(
        self,
        scenario_file: Path,
        out: Path,
        mode: str,
        tools: Toolbox,
        chapter: Callable[[str], None],
        say: Callable[[str], None],
        progress: Callable[[str, int, int], None],
        move_cycles: int = 12,
        settle_cycles: int = 2,
    ) -> None:
        self.scenario = Scenario.from_file(scenario_file)
        self.out = out
        self.mode = mode
        self.tools = tools
        self.chapter, self.say, self.progress = chapter, say, progress
        self.move_cycles, self.settle_cycles = move_cycles, settle_cycles
        self.arm = build_arm(self.scenario)
        self.figures = Figures(self.scenario.name, mode, self._hidden())
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        robot = published_robot(self.scenario, self.arm.robot)
        (out / "robot.yaml").write_text(yaml.safe_dump(robot, sort_keys=False), encoding="utf-8")
        model = {"effects": [_without_sizes(entry) for entry in self.scenario.believed]}
        (out / "model.yaml").write_text(yaml.safe_dump(model, sort_keys=False), encoding="utf-8")
        self.tools.armtrue("keygen", "--out", out / "armtrue.key", show=0)
        self.node = NodeUnderTest(out / "state", str(robot["name"]), mode, out / "armtrue.key.pub")
        self._cell_arguments = (scenario_file, out, DRIVE_BUS if mode == "inline" else CONTROLLER_BUS)
        self._uploads = 0

    def run(self) -> Figures:
        """Everything, in order. Raises RuntimeError if a part of the chain fails."""
        begin = time.monotonic()
        cell = CellProcess(*self._cell_arguments)
        try:
            self.node.start()
            operator = cell.operator()
            controller = Controller()
            try:
                fits = self._measure_and_improve(controller, operator)
                self.figures.worst_following_increments = controller.worst_following
                self.figures.cycles = controller.cycles
                self.figures.repeated_moves = controller.repeated_moves
                controller.disable()
            finally:
                controller.close()
                operator.close()
            cell.wait()
        finally:
            cell.kill()
            self.node.stop()
        self._judge(fits, json.loads(cell.truth.read_text(encoding="utf-8")))
        reports = (self.out / f"{fit}.json" for fit in fits)
        self.tools.armtrue("report", *reports, "--out", self.out / "report.html", show=0)
        self.figures.seconds = time.monotonic() - begin
        document = json.dumps(self.figures.document(), indent=1) + "\n"
        (self.out / "figures.json").write_text(document, encoding="utf-8")
        return self.figures

    def _measure_and_improve(self, controller: Controller, operator: Operator) -> dict[str, str]:
        """The chapters; the fits that were made, in order, with words for each."""
        self.chapter("measure over CAN: the arm as it is, through a compensator without a table")
        controller.configure_compensator(self.mode)
        controller.enable()
        training, test = make_plans(self.scenario, self.arm)
        self._campaign(controller, operator, training, "training")
        self._campaign(controller, operator, test, "nominal")
        self.say("$ armtrue check")
        self.tools.armtrue("check", self.out / "training.csv", "--robot", self.out / "robot.yaml", show=1)

        self.chapter("fit what the owner believes: geometry, and gravity on axes 2 and 3")
        out = self.out
        inputs = (out / "training.csv", "--robot", out / "robot.yaml", "--model", out / "model.yaml")
        self.say("$ armtrue fit")
        self.tools.armtrue("fit", *inputs, "--out", out / "believed.json", show=_LINES_OF_FIT)
        fits = {"believed": "what was believed"}
        self._into_force(controller, "believed")
        self._campaign(controller, operator, test, "believed")
        for number in range(1, MOST_ADDED + 1):
            effect = self._improve(number, list(fits)[-1])
            if effect is None:
                break
            fits[f"added-{number}"] = f"+ {effect}"
            self._into_force(controller, f"added-{number}")
            self._campaign(controller, operator, test, f"added-{number}")
        self.say("$ armtrue device info")
        self.tools.armtrue("device", "info", *BUS)
        return fits

    def _improve(self, number: int, fit: str) -> str | None:
        """Diagnose a fit and add what is recommended as the next one; the effect, None where nothing is missing."""
        self.chapter("diagnose: is anything missing?")
        file = self.out / f"{fit}-diagnosis.json"
        self.say("$ armtrue diagnose")
        self.tools.armtrue("diagnose", self.out / f"{fit}.json", "--json", file, show=_LINES_OF_DIAGNOSE)
        document = json.loads(file.read_text(encoding="utf-8"))
        self.figures.verdict = document["verdict"]
        self.figures.noise_floor_um = float(document["noise_floor_um"])
        candidate = document["candidates"][0] if document["candidates"] else {"recommend": False}
        if document["verdict"] != "missing_effect" or not candidate["recommend"]:
            return None
        effect = self._name(candidate["effect"], candidate["joints"])
        self.chapter(f"add it: {effect}")
        words = [candidate["effect"]]
        if candidate["joints"]:
            words += ["--joints", ",".join(map(str, candidate["joints"]))]
        for option, value in candidate["options"].items():
            words += ["--option", f"{option}={value}"]
        self.say("$ armtrue add FIT " + " ".join(words))
        self.tools.armtrue(
            "add", self.out / f"{fit}.json", *words, "--out", self.out / f"added-{number}.json", show=6
        )
        self.figures.found.append(effect)
        return effect

    def _campaign(self, controller: Controller, operator: Operator, plan: Plan, purpose: str) -> Session:
        # The first pose is come to like every other: from some way off.
        controller.move(plan.joints[-1], self.move_cycles, self.settle_cycles)
        session = measure(
            controller, operator, plan, purpose, self.move_cycles, self.settle_cycles,
            lambda done, total: self.progress(purpose, done, total),
        )  # fmt: skip
        (self.out / f"{purpose}.csv").write_text(session.csv(), encoding="utf-8")
        return session

    def _into_force(self, controller: Controller, name: str) -> None:
        """Export and sign a fit, upload it over CAN, confirm it."""
        self._uploads += 1
        tables = self.out / f"{name}.bin"
        self.say("$ armtrue export --sign; armtrue upload --confirm; armtrue device verify")
        options = ("--sequence", str(self._uploads), "--increments", str(INCREMENTS_PER_TURN))
        key = ("--sign", self.out / "armtrue.key")
        self.tools.armtrue("export", self.out / f"{name}.json", "--out", tables, *options, *key, show=0)
        controller.disable()  # a commit erases flash, which stops forwarding: refused under enabled drives
        controller.wait_until_quiet()
        self.tools.armtrue("upload", tables, *BUS, "--confirm")
        self.tools.armtrue("device", "verify", tables, *BUS)
        controller.catch_up()
        controller.enable()

    def _judge(self, fits: dict[str, str], records: list[dict[str, Any]]) -> None:
        """Compare with the truth, which nobody but the cell knew until now.

        The point that a pose was meant for is where nominal kinematics has the tool in the base and with the tool
        of the fit in force; for the arm as it was, of the last fit.
        """
        last = list(fits)[-1]
        for name, words in {"nominal": "the arm as it was", **fits}.items():
            intended, corrected = self._double_precision(name, last if name == "nominal" else name)
            of_step = [record for record in records if record["purpose"] == name]
            reached = self.arm.true_position(corrected, _read_csv(self.out / f"{name}.csv"))
            self.figures.steps.append(
                Step(
                    name,
                    words,
                    Errors.of(np.array([record["seen"] for record in of_step]), intended),
                    Errors.of(np.array([record["exact"] for record in of_step]), intended),
                    None if name == "nominal" else Errors.of(reached, intended),
                )
            )

    def _double_precision(self, poses: str, tables: str) -> tuple[Array, Array]:
        """Intended points (N, 3) and the double-precision commands (N, 6) for a step's poses."""
        file = self.out / f"{poses}-double.csv"
        words = (self.out / f"{tables}.bin", self.out / f"{poses}.csv", "--engine", "double", "--out", file)
        self.tools.armtrue("compensate", *words, show=0)
        columns = _read_csv(file)
        intended = np.array([columns[name] for name in ("tx", "ty", "tz")]).T
        return intended, np.array([columns[f"q{k}"] for k in range(1, 7)]).T

    def _hidden(self) -> list[str]:
        """What the scenario hides, in the words of `_name`."""
        context = context_of(self.scenario)
        return [
            self._name(effect, joints or default_joints(effect, context))
            for role, effect, joints, _ in self.scenario.entries()
            if role == "hidden"
        ]

    def _name(self, effect: str, joints: list[int]) -> str:
        """An effect with its joints, where those are not all."""
        everywhere = not joints or len(joints) == self.arm.chain.n
        return effect if everywhere else f"{effect} {','.join(map(str, joints))}"


def _without_sizes(entry: Any) -> Any:
    """A scenario's effect as its owner would write it in model.yaml."""
    if isinstance(entry, str):
        return entry
    return {key: value for key, value in entry.items() if key in ("effect", "joints")}


def _read_csv(path: Path) -> dict[str, Array]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
