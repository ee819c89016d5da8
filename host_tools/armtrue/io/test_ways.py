"""Travel of each joint since its last reversal, derived from the order of the rows."""

from __future__ import annotations

import numpy as np

from armtrue.io import load_data
from armtrue.io.ways import travels

Q = np.cumsum(np.tile([0.2, 0.3, -0.6, -0.3, 0.5], 5))  # up twice, down twice, up once, and again
SIDE = np.tile([1.0, 1.0, -1.0, -1.0, 1.0], 5)


def test_travel_counts_from_the_last_reversal() -> None:
    way = travels({"q1": Q, "dir1": SIDE})["travel1"]
    np.testing.assert_allclose(way[1:7], [np.ptp(Q) + 0.3, 0.6, 0.9, 0.5, 0.7, 1.0])


def test_travel_is_derived_in_order_of_time() -> None:
    order = np.random.default_rng(1).permutation(Q.size)
    clock = np.arange(float(Q.size))
    mixed = travels({"q1": Q[order], "dir1": SIDE[order], "time": clock[order]})["travel1"]
    np.testing.assert_array_equal(mixed, travels({"q1": Q, "dir1": SIDE})["travel1"][order])
    assert travels({"q1": Q[order], "dir1": SIDE[order]}) == {}


def test_travel_is_not_derived_if_directions_do_not_confirm_it() -> None:
    assert travels({"q1": Q, "dir1": -SIDE}) == {}
    assert travels({"q1": Q[:19], "dir1": SIDE[:19]}) == {}  # may agree by chance
    assert travels({"q1": Q}) == {}
    assert travels({"q1": Q, "dir1": SIDE, "travel1": Q}) == {}  # recorded
    # A joint at the same angle but with the other direction has moved in between.
    twice, sides = np.repeat(Q, 2), np.repeat(SIDE, 2)
    assert "travel1" in travels({"q1": twice, "dir1": sides})
    sides[1::2] *= -1.0
    assert travels({"q1": twice, "dir1": sides}) == {}


def test_row_with_contradicting_direction_has_full_travel() -> None:
    q, side = np.cumsum(np.tile(np.diff(Q, prepend=0.0), 8)), np.tile(SIDE, 8)
    side[7] = -side[7]
    way = travels({"q1": q, "dir1": side})["travel1"]
    assert way[7] == np.ptp(q)
    np.testing.assert_allclose(way[2:7], [0.6, 0.9, 0.5, 0.7, 1.0])


def test_load_data_derives_travel_with_a_note(tmp_path, two_joints) -> None:
    rows = [
        f"{q:.3f},{0.1 * i:.1f},1,2,{3 + 0.01 * i:.2f},{s:.0f}"
        for i, (q, s) in enumerate(zip(Q, SIDE, strict=True))
    ]
    path = tmp_path / "data.csv"
    # The file has all rows twice: the copies are left out.
    path.write_text("\n".join(["q1,q2,x,y,z,dir1", *rows, *rows]) + "\n")
    data = load_data(path, two_joints)
    np.testing.assert_allclose(
        data.columns["travel1"], travels({"q1": Q, "dir1": SIDE})["travel1"], atol=1e-9
    )
    assert "travel2" not in data.columns
    assert any("travel1, the travel of a joint since its last reversal" in note for note in data.notes)
    # Poses to predict keep all their rows.
    assert load_data(path, two_joints, need_position=False).count == 2 * Q.size


def test_directions_derived_from_row_order_do_not_confirm_it(tmp_path, two_joints) -> None:
    rows = [f"{q:.3f},{0.1 * i:.1f},1,2,{3 + 0.01 * i:.2f}" for i, q in enumerate(Q)]
    (tmp_path / "data.csv").write_text("\n".join(["q1,q2,x,y,z", *rows]) + "\n")
    columns = "columns: {q1: q1, q2: q2, x: x, y: y, z: z}\n"
    path = tmp_path / "dataset.yaml"
    path.write_text(f"file: data.csv\n{columns}derive: {{dir: from_order}}\n")
    assert "travel1" not in load_data(path, two_joints).columns
    path.write_text(f"file: data.csv\n{columns}derive: {{dir: from_order, travel: from_order}}\n")
    data = load_data(path, two_joints)
    np.testing.assert_allclose(data.columns["travel1"][2:7], [0.6, 0.9, 0.5, 0.7, 1.0], atol=1e-9)
