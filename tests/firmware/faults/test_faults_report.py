"""The fault tables hold the campaigns' counts; a missing count is an error."""

from __future__ import annotations

import faults_report
import pytest

SAID = {
    "storage": "[ COUNT    ] single power cuts: 70812\n[ COUNT    ] power cuts of a 16 KiB table: 4110\n"
    "[ COUNT    ] pairs of power cuts: 69227\n[ COUNT    ] failed operations followed by a power cut: 5730\n",
    "node": "[ COUNT    ] power cuts of an upload through the node: 3948, new table after 23\n"
    "[ COUNT    ] failed operations of an upload: 658, refused 640, else written again\n",
    "disturbed": "[ COUNT    ] transfers disturbed: 110\n",
    "sizes": "sizes 1 to 16384, segmented and in blocks, there and back: as sent (11 s)\n",
}
_HOUR = (
    "600 cycles of 1 ms\n5 sets came out whole, 1 cut short by a full bus, the others withheld\n"
    "60 actual positions came back exactly as commanded, 7 other frames bit-identical\n"
    "8 emergency messages; 9 faults: lost target 9\nnothing wrong\n"
)
SAID |= dict.fromkeys(faults_report.SOAK_HOURS, _HOUR)
_OF_DRIVES = (
    "7 cycles of 1 ms, inline mode, seed 1\n11 sets judged, 4 with the whole correction; 3 turns of the axis without "
    "end\n12 corrections suspended, 12 came back\nlargest step in shares of the permitted one: output 1.001, actual "
    "position 0.99\nevents: fault 1200, pause 34\nnothing wrong\n"
)
SAID |= dict.fromkeys(faults_report.DRIVE_HOURS, _OF_DRIVES)
SAID["offset mode"] = _OF_DRIVES.replace("nothing wrong", "cycle 5: a step")
SAID["inline, synchronous"] = _HOUR.replace("9 faults", "1234 faults")


def test_every_campaign_has_its_row() -> None:
    rows = [row.split(" | ") for row in faults_report.tables(SAID).splitlines() if row.startswith("| ")]
    assert [row[1].removesuffix(" |") for row in rows[1:9]] == [
        "70 812", "4 110", "69 227", "5 730", "3 948", "658", "65 536", "110",
    ]  # fmt: skip
    assert rows[10][1:] == ["9", "1 234", "9", "9 |"]
    assert [row[1] for row in rows[11:15]] == ["5", "60", "7", "0"]
    assert [row[1:] for row in rows[16:]] == [
        ["1 234", "1 234 |"], ["11", "11 |"], ["12", "12 |"], ["12", "12 |"], ["3", "3 |"], ["1.001", "1.001 |"],
        ["0.99", "0.99 |"], ["0", "1 |"],
    ]  # fmt: skip


@pytest.mark.parametrize("name", list(SAID))
def test_campaign_without_output_is_an_error(name: str) -> None:
    with pytest.raises(ValueError, match="no campaign printed"):
        faults_report.tables(SAID | {name: ""})
