"""Checks of measurements for mistakes, before any physics; each finding has evidence and a remedy."""

from armtrue.checking.report import CheckReport, Finding
from armtrue.checking.run import check, refuse_what_cannot_be_an_arm, warnings_of_fit

__all__ = ["CheckReport", "Finding", "check", "refuse_what_cannot_be_an_arm", "warnings_of_fit"]
