"""The same calibration by scipy.optimize.least_squares on vectorised NumPy, and by PyPI pybotics.

Runs in an environment of its own: `python rivals.py PROBLEM.npz` prints one JSON object with seconds and residuals.
Nothing of Armtrue is imported. Both start where Armtrue's closed form ends, with base and tool in place, as neither
finds them from nothing.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
from scipy.optimize import least_squares

MOST_EVALUATIONS = 60  # each with a Jacobian by finite differences


def rotation(rpy):
    """Rotation matrix of angles about the fixed axes x, y, z."""
    cr, sr, cp, sp, cy, sy = *_cs(rpy[0]), *_cs(rpy[1]), *_cs(rpy[2])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _cs(angle):
    return np.cos(angle), np.sin(angle)


def chain(q, a, alpha, d, theta, beta):
    """Craig's chain with Hayati's turn about y: rotations (N, 3, 3) and origins (N, 3) of every frame."""
    n = len(a)
    r = np.broadcast_to(np.eye(3), (len(q), 3, 3))
    p = np.zeros((len(q), 3))
    frames = []
    for k in range(n):
        ca, sa, cb, sb = *_cs(alpha[k]), *_cs(beta[k])
        c, s = _cs(q[:, k] + theta[k])
        turn = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]]) @ np.array(
            [[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]]
        )
        p = p + r @ np.array([a[k], 0.0, 0.0])
        r = r @ turn
        p = p + r @ np.array([0.0, 0.0, d[k]])
        z = np.zeros((len(q), 3, 3))
        z[:, 0, 0], z[:, 0, 1], z[:, 1, 0], z[:, 1, 1], z[:, 2, 2] = c, -s, s, c, 1.0
        r = r @ z
        frames.append((r, p))
    return frames


def scipy_fit(problem):
    """Fit all MDH parameters, Hayati's turns, base, tool, and a spring on every axis; residuals in micrometres."""
    q, tau, measured = problem["q"], problem["tau"], problem["measured"]
    nominal = problem["mdh"]  # a, alpha, d, theta: (n, 4)
    n = len(nominal)

    def residuals(x):
        a, alpha, d, theta, beta, spring = x[: 6 * n].reshape(6, n)
        base, tool = x[6 * n : 6 * n + 6], x[6 * n + 6 : 6 * n + 9]
        frames = chain(
            q + tau * spring,
            nominal[:, 0] + a,
            nominal[:, 1] + alpha,
            nominal[:, 2] + d,
            nominal[:, 3] + theta,
            beta,
        )
        r, p = frames[-1]
        flange = p + r @ (problem["tool"] + tool)
        turn = rotation(base[3:]) @ rotation(problem["base_rpy"])
        return ((flange @ turn.T + problem["base_position"] + base[:3] - measured) * 1e6).ravel()

    begin = time.perf_counter()
    found = least_squares(residuals, np.zeros(6 * n + 9), method="trf", x_scale="jac")
    took = time.perf_counter() - begin
    rms = float(np.sqrt(np.mean(np.sum(found.fun.reshape(-1, 3) ** 2, axis=1))))
    return {"seconds": took, "rms_um": rms, "columns": 6 * n + 9, "evaluations": int(found.nfev)}


def pybotics_fit(problem, scale):
    """By pybotics' own recipe: OptimizationHandler, and optimize_accuracy as the function of scipy's least_squares.

    It has no springs: its joint angles include the fitted springs' deflection, which saves it a fifth of the columns.
    """
    from pybotics.kinematic_chain import MDHKinematicChain
    from pybotics.optimization import OptimizationHandler, optimize_accuracy
    from pybotics.robot import Robot
    from pybotics.tool import Tool

    nominal = problem["mdh"] * np.array([scale, 1.0, scale, 1.0])
    # Rows of pybotics are alpha, a, theta, d.
    robot = Robot(MDHKinematicChain(nominal[:, [1, 0, 3, 2]].ravel()))
    robot.tool = Tool()
    robot.tool.position = problem["tool"] * scale
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = rotation(problem["base_rpy"]), problem["base_position"] * scale
    robot.world_frame = world
    handler = OptimizationHandler(
        robot=robot, kinematic_chain_mask=True, tool_mask=[True] * 3 + [False] * 3, world_mask=True
    )
    start = handler.generate_optimization_vector()
    begin = time.perf_counter()
    found = least_squares(
        optimize_accuracy, start, method="trf", x_scale="jac", max_nfev=MOST_EVALUATIONS,
        args=(handler, problem["q"] + problem["tau"] * problem["spring"], problem["measured"] * scale),
    )  # fmt: skip
    took = time.perf_counter() - begin
    rms = float(np.sqrt(np.mean(found.fun**2)) / scale * 1e6)
    return {"seconds": took, "rms_um": rms, "columns": len(start), "evaluations": int(found.nfev)}


def main() -> None:
    """Print one JSON object."""
    problem = dict(np.load(sys.argv[1]))
    print(json.dumps({"scipy": scipy_fit(problem), "pybotics": pybotics_fit(problem, 1000.0)}))


if __name__ == "__main__":
    main()
