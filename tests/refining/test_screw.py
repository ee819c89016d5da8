"""A prismatic joint has an error once per turn of its screw: it is named with its wavelength, and compensated.

It was reported as the scatter of a joint that repeats badly: "nothing missing 97 %, joint 3 repeats to 69 um".
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from armtrue.cli.conftest import armtrue
from armtrue_sim import simulate
from armtrue_sim.campaign import Campaign

LEAD_M = 0.012
WAVE_M = 6e-5
BELIEVED = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]


def scara(folder: Path, lead: float | None, poses: int = 200, **changes: Any) -> Campaign:
    """Files of a scara whose joint 3 has an error once per screw turn; `lead`: its value in robot.yaml, or none."""
    campaign = simulate(
        {
            "arm": "scara",
            "seed": 7,
            "poses": poses,
            "test_poses": 60,
            "believed": BELIEVED,
            "hidden": [
                {
                    "effect": "gear_mesh",
                    "joints": [3],
                    "orders": [1],
                    "lead": LEAD_M,
                    "sin_1": WAVE_M,
                    "cos_1": 0.0,
                }
            ],
            **changes,
        },
        folder,
    )
    robot = yaml.safe_load((folder / "robot.yaml").read_text())
    column = robot["kinematics"]["joints"][2]
    del column["lead"]
    if lead is not None:
        column["lead"] = lead
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
    return campaign


def done(folder: Path, *command: str) -> str:
    """Runs `armtrue COMMAND` in `folder`; returns what it printed."""
    ran = armtrue(*command, cwd=folder)
    assert ran.returncode in (0, 1), ran.stderr
    return ran.stdout


def refined(folder: Path) -> dict[str, Any]:
    done(folder, "fit", "data.csv", "--robot", "robot.yaml", "--model", "model.yaml", "--out", "fit.json")
    done(folder, "refine", "fit.json", "--out", "best.json", "--json", "refine.json")
    return json.loads((folder / "refine.json").read_text())  # type: ignore[no-any-return]


def left_after_compensation(folder: Path, campaign: Campaign) -> float:
    """Mean distance [m] of the true arm from the intended points, compensated by the fixed-point engine."""
    done(folder, "export", "best.json", "--out", "tables.bin")
    done(folder, "compensate", "tables.bin", "test.csv", "--engine", "fixed", "--out", "c.csv")
    corrected = np.genfromtxt(folder / "c.csv", delimiter=",", names=True)
    q = np.column_stack([corrected[f"q{k}"] for k in range(1, 5)])
    meant = np.column_stack([corrected[f"t{axis}"] for axis in "xyz"])
    return float(np.linalg.norm(campaign.arm.true_position(q) - meant, axis=1).mean())


@pytest.mark.full
@pytest.mark.parametrize(
    ("stated", "options"),
    [
        pytest.param(None, {"wavelengths": [LEAD_M]}, marks=pytest.mark.full),
        (LEAD_M, {"orders": [1.0]}),
    ],
)
def test_screw_error_is_named_and_compensated(
    stated: float | None, options: dict[str, list[float]], tmp_path: Path
) -> None:
    campaign = scara(tmp_path, stated)
    story = refined(tmp_path)
    (found,) = [effect for effect in story["effects"] if effect["effect"] not in BELIEVED]
    assert found.pop("probability") > 0.99
    assert found == {"effect": "gear_mesh", "joints": [3], **options}
    last = story["steps"][-1]
    assert last["verdict"] == "nothing_missing"
    assert not any("joint 3 repeats to" in line for line in last["advice"])
    assert left_after_compensation(tmp_path, campaign) < 0.2 * WAVE_M


def test_advice_names_wavelengths_that_a_grid_confounds(tmp_path: Path) -> None:
    # Sampled in steps of 8 mm, a wave of 12 mm equals one of 24 mm or of 6 mm.
    campaign = scara(tmp_path, None)
    table = np.genfromtxt(tmp_path / "data.csv", delimiter=",", names=True, dtype=None, encoding=None)
    q = campaign.q.copy()
    q[:, 2] = np.round(q[:, 2] / 0.008) * 0.008
    place = campaign.arm.true_position(q, campaign.data) + np.random.default_rng(1).normal(
        0.0, 1e-5, (len(q), 3)
    )
    table["q3"] = q[:, 2]
    for name, values in zip("xyz", place.T, strict=True):
        table[name] = values
    kept = ["q1", "q2", "q3", "q4", "x", "y", "z"]
    np.savetxt(
        tmp_path / "data.csv",
        np.column_stack([table[name] for name in kept]),
        delimiter=",",
        header=",".join(kept),
        comments="",
        fmt="%.9f",
    )
    advice = refined(tmp_path)["steps"][0]["advice"]
    assert any(
        line.startswith(
            "all values of q3 are on a grid of 8 mm, on which waves of 12 mm and waves of 6 mm look the same"
        )
        for line in advice
    ), advice
