"""Does the stated covariance of predictions cover their errors, if the model has all effects of the arm?"""

from __future__ import annotations

from typing import Any

import numpy as np
from armtrue import _core
from known_arm import GEOMETRY, KnownArm

ARMS = 60
CHI2_3_95 = 7.8147279  # 95 % point of chi-squared with three degrees of freedom
CASES: list[tuple[str, list[Any]]] = [
    ("kr30", ["joint_compliance"]),
    ("irb2400", ["joint_compliance", "gear_harmonics"]),
    ("cobot", ["joint_compliance", "joint_scale"]),
    ("stanford", []),
]


def share_inside(arm: str, hidden: list[Any], seed: int, pretend: float = 1.0, **scenario: Any) -> float:
    """Share of 200 fresh poses whose exact position lies in the stated 95 % region of the prediction.

    `hidden`: effects of arm, instrument and model beside geometry. `pretend`: factor on stated standard deviations, to
    show that a wrong one is detected.
    """
    known = KnownArm.of(
        {"arm": arm, "seed": seed, "believed": GEOMETRY, "hidden": hidden, **scenario}, poses=120
    )
    fit = known.fit(seed)
    test = {n: np.ascontiguousarray(v, dtype=float) for n, v in known.campaign.test.items() if n != "target"}
    covariance = np.asarray(_core.position_covariance(fit.core, test)).reshape(-1, 3, 3)
    error = fit.predicted(test) - np.stack([test[axis] for axis in "xyz"], axis=1)
    distance = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0])
    return float(np.mean(distance <= CHI2_3_95 * pretend**2))


def shares(arms: int, pretend: float = 1.0) -> list[float]:
    """`share_inside` of so many arms, of all CASES in turn, each with its own seed."""
    return [share_inside(*CASES[i % len(CASES)], seed=500 + i, pretend=pretend) for i in range(arms)]


def main() -> None:
    """Print the share over ARMS arms."""
    found = shares(ARMS)
    print(f"{100 * np.mean(found):.1f} % of {ARMS} × 200 fresh poses, worst arm {100 * min(found):.0f} %")


if __name__ == "__main__":
    main()
