"""The cell: six drives, the real arm on them, its thermometer, and a laser tracker that sees the tool.

    python -m armtrue_loop.cell SCENARIO --bus vcan1 --socket PATH --truth FILE

The arm's truth stays in this process. Over the socket, one JSON object a line, an operator can mount a
payload, let time pass and ask the tracker for a measurement; nobody can ask where the tool really is.
What it really was, measurement by measurement, is written to FILE at the end, for the judge.
"""

from __future__ import annotations

import argparse
import json
import socketserver
import struct
import sys
import threading
from pathlib import Path
from typing import Any

import can
import numpy as np
from armtrue_sim.build import build_arm
from armtrue_sim.instrument import Instrument
from armtrue_sim.scenario import Scenario

from armtrue_loop.drive import Drive
from armtrue_loop.network import open_network
from armtrue_loop.wiring import DRIVE_IDS, INCREMENTS_PER_RADIAN, JOINTS, TEMPERATURE_ID

# A change of direction smaller than this is the drives' own trembling.
DEAD_BAND_RAD = 2e-5


class Cell:
    """Drives, arm, thermometer and tracker."""

    def __init__(self, scenario: Scenario, channel: str) -> None:
        self.scenario = scenario
        self.arm = build_arm(scenario)
        self.instrument = Instrument.from_dict(scenario.instrument, scenario.where)
        self._random = np.random.default_rng([scenario.seed, 77])
        self._drive_sigma = float(scenario.repeatability.get("drive", 0.0))
        self.network = open_network(channel)
        self.drives = [Drive(self.network, node_id) for node_id in DRIVE_IDS]
        self._direction = np.zeros(JOINTS, dtype=int)
        self._anchor = self._joints()
        self.time_s = 0.0
        self.payload_kg = 0.0
        self.temperatures = self._temperatures()
        self.records: list[dict[str, Any]] = []
        self.network.subscribe(0x080, self._watch_motion)
        for drive in self.drives:
            drive.boot()
        self._send_temperatures()

    def _joints(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.array([drive.position for drive in self.drives]) / INCREMENTS_PER_RADIAN

    def _watch_motion(self, *_: object) -> None:
        """Runs after the drives have taken their targets: which way each joint last moved."""
        q = self._joints()
        moved = q - self._anchor
        far = np.abs(moved) > DEAD_BAND_RAD
        self._direction[far] = np.sign(moved[far]).astype(int)
        # The anchor trails by the dead band on the side that the joint came from.
        leading = far | (np.sign(moved) == self._direction)
        self._anchor[leading] = q[leading]

    def _temperatures(self) -> dict[str, float]:
        history = {"ambient": self.arm.reference_temperature, "rise": 13.0, "time_constant": 2000.0}
        history |= {k: v for k, v in self.scenario.temperature.items() if k in history}
        warmth = 1.0 - np.exp(-self.time_s / history["time_constant"])
        # What the thermometer says is what there is, to its resolution.
        return {name: round(history["ambient"] + history["rise"] * warmth, 2) for name in self.arm.sensors}

    def _send_temperatures(self) -> None:
        values = [round(100 * value) for value in self.temperatures.values()][:4]
        self.network.send_message(TEMPERATURE_ID, struct.pack("<4h", *values, *[0] * (4 - len(values))))

    def wait(self, seconds: float) -> dict[str, Any]:
        """Let time pass; the arm warms."""
        self.time_s += seconds
        self.temperatures = self._temperatures()
        self._send_temperatures()
        return {"time": self.time_s, **{f"temp_{name}": value for name, value in self.temperatures.items()}}

    def mount(self, payload_kg: float) -> dict[str, Any]:
        """Mount a payload at the tool point."""
        self.payload_kg = payload_kg
        return {"payload": payload_kg}

    def measure(self, purpose: str) -> dict[str, Any]:
        """A tracker measurement of the reflector as it stands: {x, y, z} in metres."""
        q = self._joints()[None, :]
        columns = {"payload": [self.payload_kg], "time": [self.time_s]}
        columns |= {f"temp_{name}": [value] for name, value in self.temperatures.items()}
        columns |= {f"dir{k + 1}": [int(self._direction[k])] for k in range(JOINTS)}
        arrays = {name: np.array(values, dtype=float) for name, values in columns.items()}
        settled = self._drive_sigma * self._random.standard_normal((1, JOINTS))
        stands = self.arm.true_position(q, arrays, motor_error=settled)
        seen = stands + self.instrument.noise(stands, self._random)
        exact = self.arm.true_position(q, arrays)[0]
        self.records.append({"purpose": purpose, "exact": exact.tolist(), "seen": seen[0].tolist()})
        return dict(zip("xyz", seen[0].tolist(), strict=True))

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """One request of the operator."""
        if "wait" in request:
            return self.wait(float(request["wait"]))
        if "mount" in request:
            return self.mount(float(request["mount"]))
        if "measure" in request:
            return self.measure(str(request["measure"]))
        if "fault" in request:
            return self.fault(str(request["fault"]))
        return {"error": f"unknown request {sorted(request)}"}

    def fault(self, what: str) -> dict[str, Any]:
        """Something goes wrong: 'power': all drives lose power and boot again where they stand."""
        if what != "power":
            return {"error": f"unknown fault '{what}'"}
        for drive in self.drives:
            drive.boot()
        return {}


class _Operator(socketserver.StreamRequestHandler):
    """Lines of JSON in, lines of JSON out, until the operator hangs up."""

    def handle(self) -> None:
        """Serve one connection."""
        cell: Cell = self.server.cell  # type: ignore[attr-defined]
        for line in self.rfile:
            answer = cell.answer(json.loads(line))
            self.wfile.write(json.dumps(answer).encode() + b"\n")


def main() -> int:
    """Run until the operator hangs up; then write the truth."""
    parser = argparse.ArgumentParser(description="Six drives, an arm and a tracker.")
    parser.add_argument("scenario", type=Path)
    parser.add_argument("--bus", default="vcan1")
    parser.add_argument("--socket", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    arguments = parser.parse_args()
    try:
        cell = Cell(Scenario.from_file(arguments.scenario), arguments.bus)
    except (OSError, can.CanError) as problem:
        print(f"cell: {arguments.bus}: {problem}", file=sys.stderr)
        return 2
    with socketserver.UnixStreamServer(str(arguments.socket), _Operator) as server:
        server.cell = cell  # type: ignore[attr-defined]
        thread = threading.Thread(target=server.handle_request)
        thread.start()
        thread.join()
    cell.network.disconnect()
    arguments.truth.write_text(json.dumps(cell.records) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
