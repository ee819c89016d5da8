"""A fit's time beside scipy and PyPI pybotics on the same problem, its growth, and the least operations it needs.

`./dev bench fit` runs it; --rivals PYTHON is the interpreter that has scipy and pybotics. Everything in one run. The
last of the three goes to standard error: it is for work on the fitter and not kept in docs/results.md.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from armtrue import _core
from armtrue_sim import simulate
from armtrue_sim.campaign import Campaign, joints_of

HERE = Path(__file__).resolve().parent
MODEL = [
    *("base_frame", "tool_offset", "joint_offset", "link_geometry"),
    {"effect": "joint_compliance", "joints": [1, 2, 3, 4, 5, 6]},
]


def campaign(poses: int) -> Campaign:
    """A KR30-like arm with geometry and springs all wrong."""
    return simulate(
        {
            "arm": "kr30",
            "seed": 7,
            "poses": poses,
            "test_poses": 10,
            "believed": MODEL,
            "repeats": {"poses": 0, "times": 0},
            "payloads": [0.0],
            "columns": {"add": ["tau"]},
        }
    )


def columns_of(c: Campaign) -> dict[str, Any]:
    """Columns without the torques, which the fit computes from the masses."""
    return {
        name: np.ascontiguousarray(v, dtype=float) for name, v in c.data.items() if not name.startswith("tau")
    }


def fit_once(c: Campaign, cross_validate: bool) -> tuple[float, Any]:
    """Seconds that a fit takes, and the fit."""
    columns, robot = columns_of(c), json.dumps(c.robot)
    options = json.dumps({"cross_validate": cross_validate})
    begin = time.perf_counter()
    fit = _core.fit(robot, columns, json.dumps({"effects": MODEL}), options)
    return time.perf_counter() - begin, fit


def rms_um(fit: Any) -> float:
    """RMS of the remaining distances [um]."""
    return float(np.sqrt(np.mean(np.sum(np.asarray(fit.residuals()) ** 2, axis=1))) * 1e6)


def problem_file(c: Campaign, fit: Any, path: Path) -> None:
    """The same problem without Armtrue: nominal arm, joints, torques, measurements, base and tool to start from."""
    document = json.loads(fit.document())
    joints = c.robot["kinematics"]["joints"]
    base, tool = document["measuring_from_base"], document["flange_from_tool"][""]
    np.savez(
        path,
        q=joints_of(c.data, len(joints)),
        tau=np.stack([np.asarray(c.data[f"tau{k + 1}"], dtype=float) for k in range(len(joints))], axis=1),
        measured=np.stack([np.asarray(c.data[axis], dtype=float) for axis in "xyz"], axis=1),
        mdh=np.array([[j["a"], j["alpha"], j["d"], j.get("offset", 0.0)] for j in joints]),
        base_position=base["xyz"],
        base_rpy=base["rpy"],
        tool=tool["xyz"],
        spring=[p["value"] for p in document["parameters"] if p["effect"] == "joint_compliance"],
    )


def compare(rivals: str) -> None:
    """Print the table of solvers."""
    c = campaign(300)
    plain = [fit_once(c, False) for _ in range(30)]
    validated = [fit_once(c, True) for _ in range(30)]
    ours, fit = min(t for t, _ in plain), plain[0][1]
    parameters = json.loads(fit.document())["parameters"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.npz"
        problem_file(c, fit, path)
        environment = {**os.environ, "PYTHONPATH": "", "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(
            [rivals, str(HERE / "rivals.py"), str(path)],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
        )
    others = json.loads(done.stdout)
    print("300 poses, geometry and six springs (best of 30 for Armtrue, one run of the others)\n")
    print("| solver | columns | time [ms] | times Armtrue's | residual RMS [um] | evaluations |")
    print("|---|---|---|---|---|---|")
    best = min(t for t, _ in validated)
    lines: list[tuple[str, int, float, str, str]] = [
        ("armtrue, base and tool from nothing, covariance", len(parameters), ours, f"{rms_um(fit):.2f}", ""),
        ("armtrue, and held-out errors three ways", len(parameters), best, "", ""),
    ]
    for name, other in others.items():
        rms = f"{other['rms_um']:.2f}"
        lines.append((name, other["columns"], other["seconds"], rms, str(other["evaluations"])))
    for name, columns, seconds, rms, evaluations in lines:
        times = seconds / ours
        print(f"| {name} | {columns} | {1e3 * seconds:.1f} | {times:.1f} | {rms} | {evaluations} |")
    account(ours, len(parameters))


def account(seconds: float, parameters: int, rows: int = 300, joints: int = 6) -> None:
    """Print the least floating-point operations of a fit beside this machine's highest rate."""
    # Rigid transforms in a chain: 45 + 18 for each of the fixed and the joint's own, 63 for a virtual joint.
    forward = rows * (joints + 2) * 3 * 63
    # A column: a cross product and a difference (12), or a copied axis; then whitened by 3 x 3 (15).
    jacobian = rows * parameters * (12 + 15)
    normal = rows * 3 * parameters * (parameters + 1)
    factor = parameters**3 / 3 + 2 * parameters**2
    passes = 4  # two Gauss-Newton steps, one to decide what is identifiable, one for the covariance
    needed = passes * (forward + jacobian + normal + factor)
    a = np.random.default_rng(0).standard_normal((400, 400))
    a @ a
    begin = time.perf_counter()
    for _ in range(10):
        a @ a
    peak = 10 * 2 * 400**3 / (time.perf_counter() - begin)
    parts = {
        "chain": forward,
        "Jacobian": jacobian,
        "normal equations": normal,
        "factorisation": factor,
    }
    each = ", ".join(f"{name} {count / 1e6:.2f}" for name, count in parts.items())
    print(
        f"least operations [Mflop a pass]: {each}; {passes} passes: {needed / 1e6:.1f} Mflop, "
        f"{1e3 * needed / peak:.2f} ms at the {peak / 1e9:.1f} Gflop/s of this machine's dgemm; the fit takes "
        f"{1e3 * seconds:.1f} ms, {100 * needed / peak / seconds:.0f} % of that rate",
        file=sys.stderr,
    )


def growth() -> None:
    """Print time and memory over the number of poses."""
    print("\nGrowth\n")
    print("| poses | fit [s] | us a pose | peak memory [MB] |\n|---|---|---|---|")
    for poses in (1000, 10000, 100000):
        # In its own process: peak memory is known per process.
        done = subprocess.run(
            [sys.executable, __file__, "--grown", str(poses)], capture_output=True, text=True, check=True
        )
        print(done.stdout, end="", flush=True)


def grown(poses: int) -> None:
    """Print one line of the table of `growth`."""
    base = campaign(min(poses, 5000))
    times = poses // len(base.data["x"])
    rng = np.random.default_rng(1)
    # The simulator is not what is measured: further poses are copies of its poses with new noise.
    columns = {name: np.tile(v, times) for name, v in columns_of(base).items()}
    for axis in "xyz":
        columns[axis] = columns[axis] + 1e-6 * rng.standard_normal(len(columns[axis]))
    begin = time.perf_counter()
    _core.fit(json.dumps(base.robot), columns, json.dumps({"effects": MODEL}), "{}")
    took = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"| {len(columns['x'])} | {took:.2f} | {1e6 * took / len(columns['x']):.0f} | {peak:.0f} |")


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rivals", help="interpreter with scipy and pybotics")
    parser.add_argument("--grown", type=int)
    arguments = parser.parse_args()
    if arguments.grown:
        grown(arguments.grown)
        return
    compare(arguments.rivals)
    growth()


if __name__ == "__main__":
    main()
