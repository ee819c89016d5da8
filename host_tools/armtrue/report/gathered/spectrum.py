"""Joint spectra of a diagnosis: their peaks, and the names of the peaks' periods."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from armtrue.arrays import Array
from armtrue.report.parts import ARCSECOND

_LOG10_SIGNIFICANT = -4.0
# Lines within this many resolutions of a peak, or within this share of its cycles, belong to it.
_OWN_LINES = 2.0
_OWN_SHARE = 0.12
_MOST_PEAKS = 3
_MOTOR_ORDERS = (
    (0.5, "half the motor speed"),
    (1.0, "motor turn"),
    (2.0, "twice a motor turn"),
    (4.0, "four times a motor turn"),
)
_SCREW_ORDERS = ((1.0, "turn of the screw or pinion"), (2.0, "half a turn of the screw or pinion"))


@dataclass(frozen=True)
class Peak:
    """A line that stands out. `cycles`: as in its spectrum. `explained`: share of Σ r². `amplitude`: with its unit."""

    cycles: float
    explained: float
    amplitude: str
    called: str

    @property
    def short(self) -> str:
        """`called` without the unit, for a chart whose axis has the unit cycles a turn."""
        return self.called.removesuffix(" a turn").removesuffix(" cycles").removesuffix(" cycle")


@dataclass(frozen=True)
class Spectrum:
    """Share of Σ r² that a sine and cosine of each period explain, over cycles of one joint (1-based).

    `cycles`: per turn, or per metre where the joint `slides`. `once`: the cycles of its motor, or its screw or pinion.
    """

    joint: int
    slides: bool
    once: float | None
    cycles: Array
    explained: Array
    significant: float
    peaks: list[Peak]


def spectra_of(
    diagnosis: dict[str, Any], joints: list[dict[str, Any]], independent: dict[int, float]
) -> list[Spectrum]:
    """Spectra with their peaks. `independent`: number of independent readings by joint, for the significance level."""
    found = []
    for entry in diagnosis["spectra"]:
        cycles, explained = np.array(entry["cycles"]), np.array(entry["explained"])
        if cycles.size == 0:
            continue
        slides = entry.get("per") == "m"
        once = _once(joints[entry["joint"] - 1], slides)
        # Of n independent readings, −n/2 · ln(1 − share) is exponential; a quarter of the lines are independent looks.
        looks = np.log10(max(1.0, cycles.size / 4.0))
        significant = 1.0 - 10.0 ** (2.0 * (_LOG10_SIGNIFICANT - looks) / independent[entry["joint"]])
        peaks = _peaks(entry, once, significant)
        found.append(Spectrum(entry["joint"], slides, once, cycles, explained, significant, peaks))
    return found


def _once(joint: dict[str, Any], slides: bool) -> float | None:
    """Turns of the motor per turn of the joint; for a joint that slides, turns of its screw or pinion per metre."""
    ratio = abs(joint.get("gear_ratio") or 0.0)  # whichever way the motor turns
    if not slides:
        return ratio or None
    if lead := joint.get("lead"):
        return 1.0 / float(lead)
    return ratio / (2.0 * math.pi) if ratio else None


def _peaks(entry: dict[str, Any], once: float | None, significant: float) -> list[Peak]:
    slides = entry.get("per") == "m"
    cycles = np.array(entry["cycles"])
    left = np.array(entry["explained"], dtype=np.float64)
    peaks: list[Peak] = []
    while len(peaks) < _MOST_PEAKS and left.size and left.max() > significant:
        at = int(np.argmax(left))
        inner = 0 < at < left.size - 1
        if inner and entry["explained"][at] >= max(entry["explained"][at - 1], entry["explained"][at + 1]):
            key, size, unit = ("amplitude_m", 1e-6, " µm") if slides else ("amplitude_rad", ARCSECOND, "″")
            amplitude = f"{entry[key][at] / size:.1f}{unit}"
            called = name_of(float(cycles[at]), once, float(entry["resolution"]), slides)
            peaks.append(Peak(float(cycles[at]), float(left[at]), amplitude, called))
        own = max(_OWN_LINES * entry["resolution"], _OWN_SHARE * cycles[at])
        left[np.abs(cycles - cycles[at]) <= own] = 0.0
    return peaks


def name_of(cycles: float, once: float | None, resolution: float, slides: bool = False) -> str:
    """Name of the part or wave with `cycles` per turn of the joint, or per metre where it slides."""
    for order, called in _SCREW_ORDERS if slides else _MOTOR_ORDERS:
        if once and abs(cycles - order * once) < 0.5 * resolution:
            return called
    if slides:
        return f"waves of {1e3 / cycles:.3g} mm"
    whole = round(cycles)
    shown = f"{whole}" if whole and abs(cycles - whole) < 0.3 * resolution else f"{cycles:.1f}"
    return f"{shown} cycle{'' if shown == '1' else 's'} a turn"
