"""Import paths of the recordings and arms of tests/firmware, and of the simulator that they are made with."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "firmware"), str(ROOT / "sim")]
