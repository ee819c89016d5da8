"""All checks in order: first what needs no kinematics, then what base and tool found from nothing tell."""

from __future__ import annotations

from armtrue.checking import (
    columns,
    conventions,
    drift,
    motion,
    orientations,
    residuals,
    tell,
    units,
)
from armtrue.checking.alignment import align, alignment_columns
from armtrue.checking.report import CheckReport, Finding
from armtrue.io.columns import POSITION
from armtrue.io.dataset import Dataset, fixed_targets, without_fixed_targets
from armtrue.io.plausible import too_few_poses
from armtrue.io.robot import Robot


def check(data: Dataset, robot: Robot) -> CheckReport:
    """Check `data` (read with `strict=False`) of `robot` for mistakes before any physics.

    Errors: none of its own; what is wrong is a finding.
    """
    findings = [
        *units.find(data, robot),
        *motion.find(data, robot),
        *drift.find(data),
        *columns.find(data),
    ]
    if all(name in data.columns for name in POSITION):
        findings += _against_kinematics(data, robot)
    return CheckReport.of(findings)


def _against_kinematics(data: Dataset, robot: Robot) -> list[Finding]:
    riding = without_fixed_targets(data) if fixed_targets(data) else data
    too_few = too_few_poses(riding.joints)
    if too_few is not None:
        remedy = "Measure more poses, further apart; a calibration wants some 60 and more."
        return [Finding("too_few_poses", "error", too_few, {"rows": riding.count}, remedy)]
    measured = units.in_si_units(alignment_columns(riding), robot)
    findings = conventions.find(measured, robot)
    if units.positions_are_in_another(riding.columns, robot):
        # Their unit is a finding already; the one guessed to go on with may have been another than the right one.
        findings = [finding for finding in findings if finding.code != "scale"]
    if findings:
        return findings
    alignment = align(measured, robot)
    findings = orientations.find(riding, measured, robot, alignment)
    if findings:
        return findings
    return [
        *residuals.find_gross(riding, alignment),
        *residuals.find_stated_poses(riding, alignment, robot),
        *tell.find(riding, robot),
    ]
