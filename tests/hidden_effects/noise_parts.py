"""Campaigns in which one joint repeats badly: is it named, and is its repeatability right?

`./dev hidden noise`: 300 poses, one joint repeats to 45 urad, the others to 4, the instrument reads to 8 um. The
figures are those of `diagnose --json`: `noise.joints_urad` and `noise.reading_um`. Also: do the 95 % regions of
`predict --uncertainty` contain 95 % of fresh exact poses?
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from armtrue_sim import simulate
from armtrue_sim.kinds import ARMS
from by_command import run
from harness import misses

BAD, GOOD, READING = 45e-6, 4e-6, 8e-6  # rad, rad, m
BAD_WITHIN, READING_WITHIN = 8.0, 1.0  # urad, um


@dataclass
class NoiseFound:
    """Result of one campaign. joints_urad is empty and reading_um None if this build does not report `noise`."""

    arm: str
    seed: int
    bad: int
    joints_urad: list[float] = field(default_factory=list)
    reading_um: float | None = None
    # Share of fresh exact poses within their 95 % region. None if the diagnosis says that an effect is missing.
    held: float | None = None
    trouble: str = ""

    @property
    def named(self) -> bool:
        """True if the joint reported to repeat worst is the bad one."""
        return bool(self.joints_urad) and int(np.argmax(self.joints_urad)) + 1 == self.bad

    @property
    def within(self) -> bool:
        """True if the bad joint is named and both figures are within BAD_WITHIN and READING_WITHIN."""
        if not self.named or self.reading_um is None:
            return False
        off = abs(self.joints_urad[self.bad - 1] - 1e6 * BAD)
        return off <= BAD_WITHIN and abs(self.reading_um - 1e6 * READING) <= READING_WITHIN


def scenario(arm: str, seed: int) -> tuple[dict[str, Any], int]:
    """The campaign, and which joint repeats badly: any but the last, whose lever is only centimetres."""
    bad = int(np.random.default_rng([seed, 45]).integers(1, 6))
    return {
        "arm": arm,
        "seed": 7000 + seed,
        "poses": 300,
        "instrument": {"sigma": READING},
        "repeatability": {"drive": GOOD, "joints": {bad: BAD}},
    }, bad


def noise_case(seed: int, limit: float) -> NoiseFound:
    """One seeded campaign; the arms take turns."""
    arm = ARMS[seed % len(ARMS)]
    given, bad = scenario(arm, seed)
    found = NoiseFound(arm, seed, bad)
    with tempfile.TemporaryDirectory(prefix="armtrue-noise-") as name:
        folder = Path(name)
        campaign = simulate(given, folder)
        files = ("data.csv", "robot.yaml", "model.yaml", "fit.json", "out.json", "test.csv", "predicted.csv")
        data, robot, model, fit, out, test, predicted = (str(folder / f) for f in files)
        for command in (
            ["fit", data, "--robot", robot, "--model", model, "--out", fit],
            ["diagnose", fit, "--json", out],
            ["predict", fit, test, "--out", predicted, "--uncertainty"],
        ):
            ran = run(command, limit)
            if ran.status != 0:
                found.trouble = "hang" if ran.hung else ran.said.strip()[-200:]
                return found
        diagnosis = json.loads((folder / "out.json").read_text())
        if diagnosis["verdict"] == "nothing_missing":
            found.held = float(np.mean(misses(Path(predicted), campaign)[1]))
        noise = diagnosis.get("noise") or {}
    found.joints_urad = [float(v or 0.0) for v in noise.get("joints_urad") or []]
    found.reading_um = noise.get("reading_um")
    return found


def table(found: list[NoiseFound]) -> str:
    """What `./dev hidden noise` prints."""
    told = [f for f in found if f.joints_urad]
    lines = [f"{len(found)} campaigns; {sum(bool(f.trouble) for f in found)} did not end well"]
    if not told:
        return lines[0] + "; this build's JSON has no `noise`.\n"
    bad = np.array([f.joints_urad[f.bad - 1] for f in told])
    right = [f.held for f in told if f.held is not None]
    reading = np.array([f.reading_um for f in told if f.reading_um is not None] or [np.nan])
    lines += [
        f"joint named: {sum(f.named for f in told)} of {len(told)}",
        f"its repeatability (true {1e6 * BAD:.0f} urad): {bad.mean():.1f}, {bad.min():.1f} to {bad.max():.1f}",
        f"reading (true {1e6 * READING:.0f} um): {reading.mean():.2f}, {reading.min():.2f} to {reading.max():.2f}",
        f"both within {BAD_WITHIN:.0f} urad and {READING_WITHIN:.0f} um: {sum(f.within for f in told)} of {len(told)}",
        f"fresh exact poses within their 95 % region: {100 * np.mean(right or [np.nan]):.1f} %, in the {len(right)} "
        "campaigns whose model lacks nothing",
    ]
    return "\n".join(lines) + "\n"
