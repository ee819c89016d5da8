"""What the loop shows: the tool's error at each step, as tables, JSON and a picture."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from armtrue_loop.plans import Array

# Demanded of the loop: the mean error over CAN against that of the double-precision engine.
LARGEST_RATIO = 1.05


@dataclass(frozen=True)
class Errors:
    """Distances of the tool from where it was meant to be, micrometres."""

    mean_um: float
    rms_um: float
    p95_um: float
    max_um: float
    each_um: tuple[float, ...]

    @classmethod
    def of(cls, positions: Array, intended: Array) -> Errors:
        """From positions and intended points (N, 3), metres."""
        distance = 1e6 * np.linalg.norm(positions - intended, axis=1)
        return cls(
            float(distance.mean()),
            float(np.sqrt((distance**2).mean())),
            float(np.percentile(distance, 95)),
            float(distance.max()),
            tuple(distance.tolist()),
        )


@dataclass(frozen=True)
class Step:
    """The same poses with one table in force (or none)."""

    name: str  # of its files
    words: str
    measured: Errors  # by the tracker: its noise and the drives' included
    exact: Errors  # by the judge, who knows the truth
    double: Errors | None  # what the double-precision engine would have reached; None without a table

    @property
    def ratio(self) -> float | None:
        """Exact mean error over CAN against that of the double-precision engine."""
        return self.exact.mean_um / self.double.mean_um if self.double else None


@dataclass
class Figures:
    """What came out, for people and for tests."""

    scenario: str
    mode: str
    hidden: list[str]
    found: list[str] = field(default_factory=list)
    verdict: str = ""
    steps: list[Step] = field(default_factory=list)
    noise_floor_um: float = 0.0
    worst_following_increments: int = 0
    cycles: int = 0
    repeated_moves: int = 0
    seconds: float = 0.0

    def shortcomings(self) -> list[str]:
        """What the loop had to show and did not, a sentence each."""
        found = []
        ratio = self.steps[-1].ratio
        if ratio is None or ratio > LARGEST_RATIO:
            found.append(
                f"the error over CAN is {ratio} times that of double precision, expected at most {LARGEST_RATIO}"
            )
        if sorted(self.found) != sorted(self.hidden):
            found.append(f"found were {self.found}, hidden were {self.hidden}")
        if self.worst_following_increments != 0:
            found.append(
                f"the controller saw a following error of {self.worst_following_increments} increments, expected none"
            )
        return found

    def document(self) -> dict[str, Any]:
        """For figures.json."""
        return asdict(self) | {"ratio_to_double": {step.name: step.ratio for step in self.steps}}


def table_of(figures: Figures) -> Table:
    """The steps as a table for the terminal."""
    count = len(figures.steps[0].measured.each_um)
    table = Table(
        title=f"Tool error over CAN [µm], {count} poses that nobody fitted", box=None, title_justify="left",
        title_style="bold", header_style="bold", pad_edge=False,
    )  # fmt: skip
    for header in ("", "mean", "rms", "max", "exact", "double", "ratio"):
        table.add_column(header, justify="left" if not header else "right", no_wrap=True)
    for step in figures.steps:
        seen = step.measured
        table.add_row(
            step.words, f"{seen.mean_um:.1f}", f"{seen.rms_um:.1f}", f"{seen.max_um:.1f}", f"{step.exact.mean_um:.2f}",
            f"{step.double.mean_um:.2f}" if step.double else "", f"{step.ratio:.3f}" if step.ratio else "",
        )  # fmt: skip
    table.add_row("noise floor, from repeats", f"{figures.noise_floor_um:.1f}", end_section=True)
    return table


def section_of(figures: Figures) -> str:
    """What docs/results.md shows of a run."""
    lines = [
        f"`{figures.scenario}`, {figures.mode} mode; hidden: {', '.join(figures.hidden)}; found: "
        f"{', '.join(figures.found)}. {len(figures.steps[0].measured.each_um)} poses, "
        f"{figures.cycles} cycles over CAN.",
        "",
        "| in force | measured mean [µm] | rms | max | exact mean | double | ratio |",
        "|---|---|---|---|---|---|---|",
    ]
    for step in figures.steps:
        seen, double = step.measured, step.double
        lines.append(
            f"| {step.words} | {seen.mean_um:.1f} | {seen.rms_um:.1f} | {seen.max_um:.1f} | {step.exact.mean_um:.2f} | "
            + (f"{double.mean_um:.2f} | {step.ratio:.3f} |" if double else "| |")
        )
    lines.append(f"| noise floor, from repeats | {figures.noise_floor_um:.1f} | | | | | |")
    return "\n".join(lines)


def draw(figures: Figures, out: Path) -> list[Path]:
    """Draw the error at each step beside the noise floor into `out`, as SVG and PNG; the files."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.ticker import FuncFormatter

    ink, faint, floor_colour = "#1b2733", "#8a97a3", "#f3c98b"
    colours = ["#b5432e", *["#c98a1b"] * (len(figures.steps) - 2), "#1f7a5a"]
    count = len(figures.steps)
    with pyplot.rc_context({"font.family": "DejaVu Sans", "font.size": 10, "svg.hashsalt": "armtrue"}):
        figure, axes = pyplot.subplots(figsize=(9.0, 1.6 + 0.72 * count), layout="constrained")
        floor = figures.noise_floor_um
        axes.axvspan(0.1, floor, color=floor_colour, alpha=0.35, lw=0, zorder=0)
        axes.axvline(floor, color="#b97a1a", lw=1.2, zorder=1)
        rng = np.random.default_rng(0)
        lowest = min(min(step.exact.mean_um, *step.measured.each_um) for step in figures.steps)
        for row, (step, colour) in enumerate(zip(figures.steps, colours, strict=True)):
            each = np.array(step.measured.each_um)
            axes.scatter(
                each,
                row + 0.14 * rng.uniform(-1, 1, each.size),
                s=16,
                color=colour,
                alpha=0.45,
                lw=0,
                zorder=3,
            )
            mean = step.measured.mean_um
            axes.plot(
                [mean, mean], [row - 0.27, row + 0.27], color=colour, lw=3.0, solid_capstyle="butt", zorder=4
            )
            axes.scatter(
                [step.exact.mean_um],
                [row],
                s=46,
                marker="D",
                facecolor="white",
                edgecolor=colour,
                lw=1.6,
                zorder=6,
            )
            axes.annotate(
                _micrometres(mean), (mean, row - 0.27), (0, 2), textcoords="offset points", ha="center",
                va="bottom", color=colour, weight="bold", zorder=5,
                bbox={"facecolor": "white", "alpha": 0.75, "pad": 1.0, "lw": 0},
            )  # fmt: skip
        axes.annotate(
            f"noise floor {_micrometres(floor)}", (floor, count - 0.42), (4, 0), textcoords="offset points",
            ha="left", va="bottom", color="#8f5c10", fontsize=9,
        )  # fmt: skip
        axes.set_xscale("log")
        axes.set_xlim(0.8 * lowest, 1.6 * max(max(step.measured.each_um) for step in figures.steps))
        axes.set_ylim(count - 0.35, -0.62)
        axes.set_yticks(range(count), [step.words for step in figures.steps])
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _axis_words(value)))
        axes.set_xlabel(
            "Distance of the tool from where it was sent. Dot: one pose that nobody fitted, measured over CAN;\n"
            "bar: their mean; diamond: the mean without the tracker's noise, which only the simulator knows.",
            color=ink,
            fontsize=9,
            loc="left",
        )
        fall = [_micrometres(figures.steps[k].measured.mean_um) for k in (0, -1)]
        axes.set_title(
            f"Tool error {fall[0]} → {fall[1]}, beside a noise floor of {_micrometres(floor)}",
            loc="left",
            fontsize=12,
            color=ink,
            weight="bold",
        )
        axes.grid(axis="x", color="#dfe4e8", lw=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(axis="y", length=0, labelcolor=ink)
        axes.tick_params(axis="x", which="both", color=faint, labelcolor=ink)
        for side in ("top", "right", "left"):
            axes.spines[side].set_visible(False)
        axes.spines["bottom"].set_color(faint)
        files = [out / "tool-error.svg", out / "tool-error.png"]
        for file in files:
            figure.savefig(file, dpi=144, metadata={"Date": None} if file.suffix == ".svg" else None)
        pyplot.close(figure)
    return files


def _micrometres(value: float) -> str:
    return (
        f"{value / 1000:.2f} mm"
        if value >= 1000
        else f"{value:.0f} µm"
        if value >= 100
        else f"{value:.1f} µm"
    )


def _axis_words(value: float) -> str:
    return f"{value / 1000:g} mm" if value >= 1000 else f"{value:g} µm"
