"""Hidden-effect campaigns through the command line: `./dev hidden [GROUP]` runs one and prints its tables.

Groups: `table` (kept in docs/results.md), `real` (arms that differ from robot.yaml), `foreign` (truths whose form no
effect has), `later` (each of the contract's later effects, ten seeds), `noise` (one joint that repeats badly), `pairs`
(causes that look alike, three seeds; kept in docs/effects.md), `each` (one case of every kind and foreign
truth, the arms in turn; `./dev test full` runs it under sanitizers). Ends with status 1 if a command hung or failed.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import noise_parts
import pairs
import reliability
from armtrue_sim.cases import hidden_cases
from armtrue_sim.errors import ScenarioError
from armtrue_sim.foreign import TRUTHS
from armtrue_sim.kinds import ARMS, KINDS, PAIR_KINDS
from armtrue_sim.presets import PRESETS
from harness import Outcome, Settings, run_case, verdict_of

# Without the palletiser: only its bars differ from the other arms, and no kind hides an effect of bars.
VARIED_ARMS = tuple(arm for arm in PRESETS if arm != "palletiser")

HEAD = (
    "| what is hidden | cases | right | found | false: all, surely | missed | hang | failed | top 1 | top 3 "
    "| ambiguity set: size | holds it | error / true effects (median, worst) | in 95 % region "
    "| coefficients within 4 sigma | s/case: median, worst |\n"
    f"|{'---|' * 16}\n"
)
GROUPS = {
    "table": [k for k in KINDS if not k.startswith(("real", "foreign", "later"))],
    "real": [k for k in KINDS if k.startswith("real")],
    "foreign": ["foreign_truth"],
    "later": [k for k in KINDS if k.startswith("later")],
    "each": list(KINDS),
}


def row(kind: str, outcomes: list[Outcome]) -> str:
    """One line of the table. found, missed: numbers of effects; false: cases that add one which the arm lacks."""
    right = [o for o in outcomes if verdict_of(o) == "right"]
    # A truth whose form no effect has cannot be found by name: verdict_of judges the answer.
    nameable = [o for o in outcomes if o.kind not in ("outside_catalogue", "foreign_truth")]
    wanted = sum(len(o.hidden) for o in nameable)
    found = sum(len(o.hidden & o.added) for o in nameable)
    hangs = sum(o.trouble.startswith("hang") for o in outcomes)
    failed = sum(bool(o.trouble) for o in outcomes) - hangs
    named = [
        sum(bool(o.first) and o.first[0] <= o.hidden for o in outcomes),
        sum(any(words <= o.hidden for words in o.first) for o in outcomes),
        sum(o.covered for o in outcomes),
    ]
    sizes = [1 + len(o.ambiguity) for o in outcomes if o.first]
    ratios = [o.error_ratio for o in right if o.error_ratio == o.error_ratio]
    held = [inside for o in right for inside in o.held]
    off = [abs(d) for o in outcomes if o.found for d in o.deviations.values()]
    seconds = [o.seconds for o in outcomes if o.seconds == o.seconds]
    false = (
        f"{sum(bool(o.extras - o.causes) for o in outcomes)}, {sum(bool(o.surely_false) for o in outcomes)}"
    )
    cells = [
        *(kind.replace("_", " "), len(outcomes), len(right)),
        *(f"{found} of {wanted}", false, wanted - found, hangs, failed, *named[:2]),
        *(f"{statistics.mean(sizes):.1f}" if sizes else "–", named[2]),
        f"{statistics.median(ratios):.3f}, {max(ratios):.3f}" if ratios else "–",
        f"{100 * sum(held) / len(held):.1f} %" if held else "–",
        f"{sum(d <= 4.0 for d in off)} of {len(off)}" if off else "–",
        f"{statistics.median(seconds):.2f}, {max(seconds):.2f}" if seconds else "–",
    ]
    return "| " + " | ".join(map(str, cells)) + " |\n"


def seeds_of(kind: str, given: argparse.Namespace) -> range:
    """As many seeds as requested; a kind of later effect has about ten cases over all its arms."""
    count = given.seeds
    if kind == "nothing_hidden" and given.nothing_seeds:
        count = given.nothing_seeds
    if kind.startswith("later"):
        count = -(-min(given.seeds, 10) // len(KINDS[kind].arms))
    return range(given.first_seed, given.first_seed + count)


def cases_of(kind: str, given: argparse.Namespace) -> list[tuple[str, int]]:
    """Arms and seeds; in the group `each` one case, or one of each foreign truth, on the arms in turn."""
    seeds = seeds_of(kind, given)
    arms = VARIED_ARMS if given.variants and KINDS[kind].arms == ARMS else KINDS[kind].arms
    if given.group == "each":
        arm = arms[list(KINDS).index(kind) % len(arms)]
        found: dict[str, int] = {}  # the first seed of each truth
        seed = seeds[0]
        while KINDS[kind].source == "truths" and len(found) < len(TRUTHS):
            found.setdefault(hidden_cases(kind, arm, seed).hidden[0].effect, seed)
            seed += 1
        return [(arm, seed) for seed in found.values() or seeds[:1]]
    return [(arm, seed) for arm in arms for seed in seeds]


def run_kinds(kinds: Iterable[str], given: argparse.Namespace, pool: ProcessPoolExecutor) -> list[Outcome]:
    """Run all cases and print the table; wrong ones go to stderr when their kind is complete."""
    settings = Settings(
        given.limit,
        None,
        not given.no_reference,
        given.statics,
        given.variants,
        given.keep,
        given.ratios,
        given.masses,
    )
    print(HEAD, end="", flush=True)
    begun = [
        (kind, [pool.submit(_case_or_none, kind, arm, seed, settings) for arm, seed in cases_of(kind, given)])
        for kind in kinds
    ]
    everything = []
    for kind, jobs in begun:
        outcomes = [outcome for job in jobs if (outcome := job.result())]
        for o in outcomes:
            if verdict_of(o) != "right":
                words = f"hidden {sorted(o.hidden)}, added {sorted(o.added)} {o.trouble}"
                print(f"{verdict_of(o)}: {kind} {o.arm} {o.seed}: {words}", file=sys.stderr, flush=True)
        print(row(kind, outcomes), end="", flush=True)
        everything += outcomes
    return everything


def run_pairs(kinds: Iterable[str], given: argparse.Namespace, pool: ProcessPoolExecutor) -> list[Outcome]:
    """Run all cases of pairs; answers other than right, both and no column go to stderr."""
    settings = Settings(given.limit, None, False, given.statics, keep=given.keep)
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    calls = [(kind, arm, seed, settings) for kind in kinds for arm in PAIR_KINDS[kind].arms for seed in seeds]
    outcomes = [outcome for outcome in in_parallel(pool, _case_or_none, calls) if outcome]
    for o in outcomes:
        if (said := pairs.answer(o)) not in ("right", "both", "no column"):
            words = f"added {sorted(o.added)}, surely {sorted(o.added & o.sure)}, or {sorted(o.stand_ins)}"
            print(f"{said}: {o.kind} {o.arm} {o.seed}: {words} {o.verdict} {o.trouble}", file=sys.stderr)
    return outcomes


def _case_or_none(kind: str, arm: str, seed: int, settings: Settings) -> Outcome | None:
    """Run a case; None, with a message, if its kind cannot be seen on this arm (masses, if all axes are vertical)."""
    try:
        return run_case(kind, arm, seed, settings)
    except ScenarioError as error:
        print(f"left out: {error}", file=sys.stderr, flush=True)
        return None


def in_parallel(
    pool: ProcessPoolExecutor, work: Callable[..., Any], calls: list[tuple[Any, ...]]
) -> list[Any]:
    """Results of work(*call) in the order of the calls."""
    return [job.result() for job in [pool.submit(work, *call) for call in calls]]


def main() -> None:
    """Run the group's kinds over all their arms and seeds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("group", nargs="?", choices=[*GROUPS, "noise", "pairs"], default="table")
    parser.add_argument(
        "--seeds",
        type=int,
        help="seeds for each kind and arm (default: 25, of pairs 3); of noise: 4 times that",
    )
    parser.add_argument(
        "--nothing-seeds", type=int, help="seeds for each arm with nothing hidden (default: 2 x seeds)"
    )
    parser.add_argument("--first-seed", type=int, default=0, help="other cases than the table's")
    parser.add_argument(
        "--only", choices=[*KINDS, *PAIR_KINDS], metavar="KIND", help="this kind of case alone"
    )
    parser.add_argument("--limit", type=float, default=300.0, help="seconds until a command counts as hung")
    parser.add_argument(
        "--no-reference", action="store_true", help="without the fit that is handed the truth"
    )
    parser.add_argument("--statics", choices=["deflected", "nominal"], default="deflected")
    parser.add_argument(
        "--variants", action="store_true", help="each seed on an arm of its own; scara, stanford, rail too"
    )
    parser.add_argument(
        "--ratios",
        choices=["known", "negative", "none", "wrong"],
        default="known",
        help="gear ratios in robot.yaml",
    )
    parser.add_argument(
        "--masses", choices=["known", "none"], default="known", help="masses of links in robot.yaml"
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="leave every case's files in a folder of its own here")
    given = parser.parse_args()
    given.seeds = given.seeds or (3 if given.group == "pairs" else 25)
    given.nothing_seeds = given.nothing_seeds or 2 * given.seeds
    with ProcessPoolExecutor(given.jobs) as pool:
        if given.group == "noise":
            first = given.first_seed
            calls = [(seed, given.limit) for seed in range(first, first + 4 * given.seeds)]
            print(noise_parts.table(in_parallel(pool, noise_parts.noise_case, calls)), end="")
            return
        if given.group == "pairs":
            print(pairs.table(run_pairs([given.only] if given.only else PAIR_KINDS, given, pool)), end="")
            return
        outcomes = run_kinds([given.only] if given.only else GROUPS[given.group], given, pool)
    print("\nWhat is said with a probability, and how often it is so:\n")
    print(reliability.table([pair for o in outcomes for pair in o.said]), end="")
    if any(o.trouble for o in outcomes):
        sys.exit(1)


if __name__ == "__main__":
    main()
