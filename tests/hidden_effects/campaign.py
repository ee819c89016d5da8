"""The whole hidden-effect campaign: `./dev hidden` runs it and keeps its table in docs/results.md."""

from __future__ import annotations

import argparse
import statistics
import sys
from concurrent.futures import ProcessPoolExecutor

from armtrue_sim.cases import ARMS, KINDS
from harness import Outcome, run_case, verdict_of

HEAD = (
    "| what is hidden | cases | right | top 1 | top 3 | extras | ambiguity set: size | holds it "
    "| error / true effects (median, worst) | s/case |\n"
    "|---|---|---|---|---|---|---|---|---|---|\n"
)


def row(kind: str, outcomes: list[Outcome]) -> str:
    """One line of the table."""
    right = sum(verdict_of(o) == "right" for o in outcomes)
    first = sum(bool(o.first) and o.first[0] <= o.hidden for o in outcomes)
    three = sum(any(words <= o.hidden for words in o.first) for o in outcomes)
    extras = sum(bool(o.extras) for o in outcomes)
    sizes = [1 + len(o.ambiguity) for o in outcomes if o.first]
    ratios = [o.error_ratio for o in outcomes if verdict_of(o) == "right" and o.error_ratio == o.error_ratio]
    covered = sum(o.covered for o in outcomes)
    tops = [str(first), str(three), str(covered)]
    if kind in ("nothing_hidden", "outside_catalogue"):
        tops = ["–"] * 3
    ratio = f"{statistics.median(ratios):.3f}, {max(ratios):.3f}" if ratios else "–"
    seconds = statistics.median(o.seconds for o in outcomes)
    return (
        f"| {kind.replace('_', ' ')} | {len(outcomes)} | {right} ({100 * right / len(outcomes):.1f} %) "
        f"| {tops[0]} | {tops[1]} "
        f"| {extras} | {statistics.mean(sizes):.1f} | {tops[2]} | {ratio} | {seconds:.2f} |\n"
    )


def main() -> None:
    """Run all kinds over all arms and seeds; failures go to stderr as they come."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=25, help="seeds for each kind and arm")
    parser.add_argument(
        "--nothing-seeds", type=int, default=50, help="seeds for each arm with nothing hidden"
    )
    parser.add_argument("--first-seed", type=int, default=0, help="other cases than the table's")
    parser.add_argument("--only", choices=KINDS, help="this kind of case alone")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    first = given.first_seed
    print(HEAD, end="", flush=True)
    with ProcessPoolExecutor(given.jobs) as pool:
        for kind in [given.only] if given.only else KINDS:
            seeds = given.nothing_seeds if kind == "nothing_hidden" else given.seeds
            jobs = [
                pool.submit(run_case, kind, arm, seed) for arm in ARMS for seed in range(first, first + seeds)
            ]
            outcomes = [job.result() for job in jobs]
            for o in outcomes:
                if verdict_of(o) != "right":
                    print(
                        f"{verdict_of(o)}: {kind} {o.arm} {o.seed}: hidden {sorted(o.hidden)}, added {sorted(o.added)}",
                        file=sys.stderr,
                        flush=True,
                    )
            print(row(kind, outcomes), end="", flush=True)


if __name__ == "__main__":
    main()
