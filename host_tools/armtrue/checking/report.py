"""The findings of a check."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from armtrue.notebook import html_table
from armtrue.units import plural

Severity = Literal["error", "warning", "note"]
_ORDER: dict[Severity, int] = {"error": 0, "warning": 1, "note": 2}


@dataclass(frozen=True)
class Finding:
    """One finding: a fixed `code`, a sentence, the figures behind it (JSON-able, SI units), and what to do."""

    code: str
    severity: Severity
    message: str
    evidence: dict[str, Any] = field(default_factory=dict)
    remedy: str = ""


@dataclass(frozen=True)
class CheckReport:
    """All findings, the gravest first."""

    findings: list[Finding]

    @staticmethod
    def of(findings: list[Finding]) -> CheckReport:
        """Put `findings` in order of severity, otherwise as they came."""
        return CheckReport(sorted(findings, key=lambda finding: _ORDER[finding.severity]))

    @property
    def has_errors(self) -> bool:
        """True where a finding makes a fit meaningless."""
        return any(finding.severity == "error" for finding in self.findings)

    def summary(self) -> str:
        """One sentence that counts the findings."""
        found = [finding.severity for finding in self.findings]
        return ", ".join(plural(found.count(severity), severity) for severity in _ORDER)

    def document(self) -> dict[str, Any]:
        """JSON-able form; a figure that is not finite is null."""
        findings = [_without_infinities(asdict(finding)) for finding in self.findings]
        return {"ok": not self.has_errors, "findings": findings}

    def _repr_html_(self) -> str:
        rows = [[f.severity, f.code, f.message, f.remedy] for f in self.findings]
        return html_table(["", "finding", "what", "what to do"], rows, self.summary())

    def __str__(self) -> str:
        lines = [
            f"{f.severity}: {f.code}: {f.message.rstrip('.')}. {f.remedy}".rstrip() for f in self.findings
        ]
        return "\n".join([*lines, self.summary()])


def _without_infinities(value: Any) -> Any:
    """`value`, a tree of dictionaries and lists, with None for numbers that are not finite, which JSON lacks."""
    if isinstance(value, dict):
        return {key: _without_infinities(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_without_infinities(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
