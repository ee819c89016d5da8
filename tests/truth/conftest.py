"""Lets the tests here, and the campaign of `./dev bench`, import their harness."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
