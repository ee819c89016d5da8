"""Fixed-point against double on 100 000 random reachable poses of each simulated arm: the table for docs/results.md.

    accuracy_report.py [--poses N]

The measure is that of test_accuracy.py, which holds 6000 poses an arm to the same bounds in every test run.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "sim"), str(ROOT)]

import arms  # noqa: E402
import numpy as np  # noqa: E402
import test_accuracy  # noqa: E402
from armtrue.tables import fixed as engine_flags  # noqa: E402

CHUNK = 10_000
HEAD = """\
| arm | held | poses away from singularities | mean [µm] | max [µm] | nearer: mean [µm] | max [µm] |
|---|---|---|---|---|---|---|
"""


def row(case: tuple[str, bool, int]) -> tuple[str, bool]:
    """A line of the table for one arm, and whether it keeps the bounds."""
    name, full_pose, poses = case
    parts = [
        test_accuracy.measured(name, full_pose, min(CHUNK, poses), seed=100 + i)
        for i in range(max(1, poses // CHUNK))
    ]
    all_ = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    regular = all_["regular"]
    clamped = all_["flags"] & engine_flags.MAGNITUDE_CLAMPED != 0
    near = all_["nearly_regular"] & ~regular & ~clamped
    um = all_["um"]
    good = (
        um[regular].mean() <= test_accuracy.MEAN_UM
        and um[regular].max() <= test_accuracy.MAX_UM
        and np.isfinite(um).all()
    )
    text = (
        f"| {name} | {'pose' if full_pose else 'position'} | {regular.sum()} "
        f"| {um[regular].mean():.3f} | {um[regular].max():.2f} | {um[near].mean():.3f} | {um[near].max():.2f} |"
    )
    return text, bool(good)


def main() -> int:
    """Print the table; exit status 1 if a bound is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--poses", type=int, default=100_000)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    # Four joints cannot hold six coordinates.
    cases = [
        (name, full_pose, arguments.poses)
        for name in arms.ALL_EFFECTS
        for full_pose in (False, True)
        if not (full_pose and name in arms.FOUR_MOTORS)
    ]
    with multiprocessing.Pool(arguments.jobs) as pool:
        rows = pool.map(row, cases, chunksize=1)
    print(HEAD + "\n".join(text for text, _ in rows))
    return 0 if all(good for _, good in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
