"""Tables of Denavit-Hartenberg rows in any unit, each column in its own."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from armtrue import InputError
from armtrue.foreign.robots import dh_rows

FOOT_M = 0.3048


def test_every_column_has_its_own_unit(tmp_path: Path) -> None:
    table = tmp_path / "arm.csv"
    table.write_text("a [ft],alpha [mrad],d [mm],theta [deg]\n0,0,815,0\n1,1570.796,0,90\n")
    rows, _ = dh_rows(table)
    assert rows[0]["d"] == pytest.approx(0.815)
    assert rows[1]["a"] == pytest.approx(FOOT_M)
    assert rows[1]["alpha"] == pytest.approx(math.pi / 2, abs=1e-6)
    assert rows[1]["offset"] == pytest.approx(math.pi / 2)


def test_column_without_a_unit_is_written_like_its_neighbour(tmp_path: Path) -> None:
    table = tmp_path / "arm.csv"
    table.write_text("a [mm],alpha [deg],d,theta\n0,0,815,0\n350,90,0,90\n")
    rows, notes = dh_rows(table)
    assert (rows[0]["d"], rows[1]["offset"]) == pytest.approx((0.815, math.pi / 2))
    assert notes == ["arm.csv: lengths in mm, angles in deg"]


def test_unit_of_another_quantity_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "arm.csv"
    table.write_text("a [kg],alpha [deg],d [kg],theta [deg]\n0,0,815,0\n350,90,0,90\n")
    with pytest.raises(InputError, match=r"found the unit 'kg', expected one of m, cm, mm, um, in, ft"):
        dh_rows(table)
