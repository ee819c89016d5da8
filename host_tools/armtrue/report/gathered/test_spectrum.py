"""Peaks of spectra and their names."""

from __future__ import annotations

import numpy as np
import pytest

from armtrue.report.gathered.spectrum import Peak, name_of, spectra_of

JOINTS = [{"name": "A1", "gear_ratio": 101.0}, {"name": "A2"}]


def spectrum(cycles: np.ndarray, explained: np.ndarray, joint: int = 1) -> dict[str, object]:
    amplitude = np.full(cycles.size, 1e-4)
    return {
        "joint": joint,
        "resolution": 1.0,
        "cycles": cycles.tolist(),
        "explained": explained.tolist(),
        "amplitude_rad": amplitude.tolist(),
    }


def peak(cycles: np.ndarray, at: float, height: float) -> np.ndarray:
    return height * np.exp(-(((cycles - at) / 0.8) ** 2))


@pytest.mark.parametrize("ratio", [101.0, -101.0])
def test_separate_lines_are_named_strongest_first(ratio):
    cycles = np.arange(0.5, 210.0, 0.25)
    explained = peak(cycles, 13.0, 0.3) + peak(cycles, 101.0, 0.2)
    joints = [{"name": "A1", "gear_ratio": ratio}, {"name": "A2"}]
    (found,) = spectra_of({"spectra": [spectrum(cycles, explained)]}, joints, {1: 720.0, 2: 720.0})
    assert found.once == 101.0
    assert [p.called for p in found.peaks] == ["13 cycles a turn", "motor turn"]
    assert found.peaks[0].explained == pytest.approx(0.3)
    assert found.peaks[0].amplitude == "20.6″"


def test_noise_gives_no_peaks():
    rng = np.random.default_rng(6)
    cycles = np.arange(0.5, 150.0, 0.25)
    for _ in range(100):
        share = rng.exponential(2.0 / 720.0, cycles.size)
        (found,) = spectra_of({"spectra": [spectrum(cycles, share, joint=2)]}, JOINTS, {1: 720.0, 2: 720.0})
        assert not found.peaks


@pytest.mark.parametrize(
    ("cycles", "ratio", "called"),
    [
        (1.02, None, "1 cycle a turn"),
        (2.0, 101.0, "2 cycles a turn"),
        (202.1, 101.0, "twice a motor turn"),
        (50.5, 101.0, "half the motor speed"),
        (17.4, 101.0, "17.4 cycles a turn"),
    ],
)
def test_peak_is_named_by_its_cycles_and_gear_ratio(cycles, ratio, called):
    assert name_of(cycles, ratio, 1.0) == called


@pytest.mark.parametrize(("cycles", "short"), [(1.0, "1"), (17.4, "17.4"), (101.0, "motor turn")])
def test_short_name_of_a_peak_omits_the_unit_of_the_axis(cycles, short):
    assert Peak(cycles, 0.1, "2.0″", name_of(cycles, 101.0, 1.0)).short == short


def test_peaks_of_a_prismatic_joint_are_named_by_length() -> None:
    cycles = np.arange(1.0, 500.0, 0.25)
    entry = spectrum(cycles, peak(cycles, 20.0, 0.3) + peak(cycles, 100.0, 0.2))
    entry |= {"per": "m", "amplitude_m": entry.pop("amplitude_rad")}
    (found,) = spectra_of({"spectra": [entry]}, [{"type": "prismatic", "lead": 0.01}], {1: 720.0})
    assert [p.called for p in found.peaks] == ["waves of 50 mm", "turn of the screw or pinion"]
    assert [p.amplitude for p in found.peaks] == ["100.0 µm", "100.0 µm"]
