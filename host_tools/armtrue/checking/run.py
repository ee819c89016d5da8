"""All checks in order: first those without kinematics, then those that need base and tool to be found."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from armtrue.checking import (
    conventions,
    directions,
    few_values,
    gravity,
    masses,
    motion,
    orientations,
    pairing,
    residuals,
    tell,
    temperatures,
    units,
)
from armtrue.checking.alignment import align, alignment_columns
from armtrue.checking.moved import jumps, steps
from armtrue.checking.report import CheckReport, Finding
from armtrue.checking.scatter import distances, drift
from armtrue.errors import InputError
from armtrue.io.dataset import Dataset, without_fixed_targets
from armtrue.io.plausible import too_few_poses
from armtrue.io.robot import Robot

# Errors under which neither residuals nor a fit mean anything.
NO_ARM = {
    "too_few_poses", "scale", "joint_sign", "joint_zero", "coupling", "joints_in_degrees", "joints_in_radians",
    "dh_convention", "fixed_or_intrinsic_angles", "joints_swapped", "rows_shifted", "reflectors_exchanged",
    "left_handed_frame", "positions_do_not_follow", "orientations_do_not_follow", "base_step", "reflector_step",
}  # fmt: skip


def check(data: Dataset, robot: Robot) -> CheckReport:
    """Check `data` (read with `strict=False`) of `robot` for mistakes before any physics.

    Errors: none of its own; every mistake is a finding.
    """
    findings = cheap_findings(data, robot)
    data = data.take(~data.lost)
    findings += drift.find(data) if data.count else []
    hopeless = any(finding.code in NO_ARM and finding.severity == "error" for finding in findings)
    if _has_all_coordinates(data) and not hopeless:
        riding = without_fixed_targets(data)
        of_pairing = [finding.evidence for finding in findings if finding.code in pairing.CODES]
        named = [row for evidence in of_pairing for row in evidence.get("rows", [])]
        riding = riding.take(~np.isin(riding.rows, named))
        riding = replace(riding, columns=units.in_si_units(riding.columns, robot))
        alignment = align(alignment_columns(riding), robot)
        findings += residuals.find_gross(riding, alignment)
        findings += residuals.find_stated_poses(riding, alignment, robot)
        findings += gravity.find(alignment.measuring_from_base, robot)
        findings += tell.find(riding, robot)
        if any(finding.code == "repeats_drift" for finding in findings):
            # The drift then adds to the scatter of repeats.
            findings = [finding for finding in findings if finding.code != "sigma_too_small"]
    return CheckReport.of(findings)


def cheap_findings(data: Dataset, robot: Robot) -> list[Finding]:
    """Findings that need no fit, in milliseconds if nothing is wrong; `fit` asks for them before it begins."""
    in_radians = replace(data, columns=units.joints_in_si_units(data.columns, robot))
    findings = [
        *units.find(data, robot),
        *masses.find(data, robot),
        *motion.find(in_radians, robot),
        *few_values.find(in_radians, robot),
        *directions.find(data),
        *temperatures.find(data),
        *temperatures.without_columns(data, robot),
        *(Finding("reader", "note", note) for note in data.notes),
    ]
    data = data.take(~data.lost)
    if not _has_all_coordinates(data):
        return findings
    against = _against_kinematics(data, robot)
    if any(finding.code == "rows_shifted" for finding in against):
        # A shift begins or ends with a repeated position: removing that row alone does not correct the shift.
        findings = [finding for finding in findings if finding.code != "stale_position"]
    return [*findings, *against]


def refuse_what_cannot_be_an_arm(data: Dataset, robot: Robot) -> list[str]:
    """Raise InputError with the first error of `cheap_findings`, which would make a fit meaningless.

    Return its warnings, each with its remedy: mistakes that may bias the fit.
    """
    findings = cheap_findings(data, robot)
    for finding in findings:
        if finding.severity == "error":
            raise InputError(
                f"{data.path}: {finding.message}; to correct it: {finding.remedy.rstrip('.')} "
                "('armtrue check' says more, --force fits anyway)"
            )
    return _with_remedies(finding for finding in findings if finding.severity == "warning")


def warnings_of_fit(base: dict[str, Any], robot: Robot) -> list[str]:
    """Warnings about robot.yaml that need the fitted base, with remedies. `base`: measuring_from_base of fit.json."""
    return _with_remedies(gravity.find(base, robot))


def _with_remedies(findings: Iterable[Finding]) -> list[str]:
    return [f"{finding.message}. {finding.remedy}" for finding in findings]


def _has_all_coordinates(data: Dataset) -> bool:
    """True where x, y and z were measured."""
    return data.has_positions and data.count > 0 and all(data.columns[name].any() for name in "xyz")


def _against_kinematics(data: Dataset, robot: Robot) -> list[Finding]:
    riding = without_fixed_targets(data)
    too_few = too_few_poses(riding.joints)
    if too_few is not None:
        remedy = "Measure more poses, further apart; a calibration needs about 60 or more."
        return [Finding("too_few_poses", "error", too_few, {"rows": riding.count}, remedy)]
    measured = units.in_si_units(alignment_columns(riding), robot)
    misplaced, rows = pairing.find(riding, measured, robot)
    if any(finding.severity == "error" for finding in misplaced):
        # With misplaced rows, a wrong scale or zero may seem to explain the residuals.
        return misplaced
    if rows.any():
        riding = riding.take(~rows)
        measured = {name: values[~rows] for name, values in measured.items()}
    findings = conventions.find(measured, robot, lambda reading: jumps.hypotheses(riding, reading))
    if units.positions_are_in_another(riding.columns, robot):
        # Their unit is a finding already; the unit assumed for the other checks may be a wrong one.
        findings = [finding for finding in findings if finding.code != "scale"]
    if not any(finding.severity == "error" for finding in findings):
        moved = steps.find(riding, measured, robot)
        # A reflector step also changes distances between reflectors: these are then not checked.
        findings += moved
        if not any(finding.code == "reflector_step" for finding in moved):
            findings += distances.find(riding)
        findings += orientations.find(riding, measured, robot)
    return [*misplaced, *findings]
