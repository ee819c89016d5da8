"""Names of temperature sensors, which become names in expressions."""

from __future__ import annotations

import re


def is_sensor(name: str) -> bool:
    """True where expressions can read `dT_name`: letters, digits and underscores."""
    return re.fullmatch(r"[A-Za-z0-9_]+", name) is not None


def contract_name(header: str) -> str:
    """`temp_arm_1` for `temp_arm 1` or `temp_arm-1 (°C)`; any other header as it is."""
    if not header.startswith("temp_"):
        return header
    sensor = re.sub(r"\s*[(\[].*$", "", header.removeprefix("temp_"))
    return "temp_" + re.sub(r"[^A-Za-z0-9_]+", "_", sensor).strip("_")
