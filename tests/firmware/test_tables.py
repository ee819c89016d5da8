"""Table images by the command line: written, inspected, signed, refused, evaluated by both engines."""

from __future__ import annotations

import base64
import csv
import io
import json
import struct
import subprocess
import zlib
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import arms
import numpy as np
import pytest
from armtrue.cli.app import main
from armtrue.tables import ExportOptions, export, layout, validate
from armtrue.tables.image import Image


@dataclass(frozen=True)
class Said:
    """What a command printed."""

    stdout: str
    stderr: str


def armtrue(*arguments: object, status: int = 0) -> Said:
    """Run the command in this process, as it would run from the shell."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr("sys.argv", ["armtrue", *map(str, arguments)])
        try:
            main()
        except SystemExit as ended:
            code = int(ended.code or 0)
    assert code == status, out.getvalue() + err.getvalue()
    return Said(out.getvalue(), err.getvalue())


@pytest.fixture
def fit(tmp_path: Path) -> Path:
    path = tmp_path / "fit.json"
    path.write_text(arms.full_document("kr30", grid_nodes=6))
    return path


def poses(path: Path, rows: int = 50, **columns: float) -> Path:
    rng = np.random.default_rng(1)
    arm = arms.full_arm("kr30")
    joints = arms.random_joints(arm, rows, rng) * 0.5
    names = [*(f"q{k}" for k in range(1, 7)), *columns]
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(names)
        for row in joints:
            writer.writerow([f"{v:.9f}" for v in row] + [str(v) for v in columns.values()])
    return path


def read(path: Path) -> dict[str, np.ndarray]:
    with path.open() as stream:
        rows = list(csv.DictReader(stream))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_sizes_of_complete_tables() -> None:
    """Geometry, compliance, thermal, harmonics, backlash and 3 degree tables: 8 KiB; with a 6 x 6 x 6 fan grid: 16."""
    without = export(arms.full_arm("kr30"), ExportOptions()).image
    with_grid = export(arms.full_arm("kr30", grid_nodes=6), ExportOptions()).image
    print(f"{len(without)} bytes, with a grid {len(with_grid)} bytes")
    assert len(without) <= 8 * 1024
    assert len(with_grid) <= 16 * 1024


def test_model_too_costly_for_a_cycle_is_refused(fit: Path, tmp_path: Path) -> None:
    document = json.loads(fit.read_text())
    document["parameters"] += [
        arms.parameter(f"motor{1 + n % 6}", f"abs(sin({n}*q{1 + n % 6}))", 1e-6) for n in range(11, 140)
    ]
    costly = tmp_path / "costly.json"
    costly.write_text(json.dumps(document))
    tables = tmp_path / "tables.bin"
    said = armtrue("export", costly, "--out", tables, status=2).stderr
    assert said.startswith(f"armtrue: {costly}: found a model that takes up to ")
    assert "instructions of a control cycle, expected at most 50000; fit fewer effects" in said
    assert not tables.exists()


def test_info_states_the_cost_of_a_cycle(fit: Path, tmp_path: Path) -> None:
    tables = tmp_path / "tables.bin"
    armtrue("export", fit, "--out", tables)
    said = armtrue("tables", "info", tables, "--json", tmp_path / "info.json").stdout
    figures = json.loads((tmp_path / "info.json").read_text())
    assert 15_000 < figures["cycle_instructions"] < figures["cycle_instructions_budget"] == 50_000
    assert f"a control cycle takes at most {figures['cycle_instructions']} instructions of 50000" in said


def test_fixed_and_double_engine_agree_on_the_command_line(fit: Path, tmp_path: Path) -> None:
    tables = tmp_path / "tables.bin"
    armtrue("export", fit, "--out", tables)
    table = poses(tmp_path / "poses.csv", temp_arm=31.5, payload=8.0, time=1200.0)
    said = armtrue("compensate", tables, table, "--engine", "fixed", "--out", tmp_path / "f.csv").stdout
    assert "dir1" in said
    assert "no direction" in said
    assert "payload" not in said
    armtrue("compensate", tables, table, "--engine", "double", "--out", tmp_path / "d.csv")
    fixed, double, asked = read(tmp_path / "f.csv"), read(tmp_path / "d.csv"), read(table)
    assert list(fixed) == ["q1", "q2", "q3", "q4", "q5", "q6", "tx", "ty", "tz"]
    for axis in ("tx", "ty", "tz"):
        assert np.array_equal(fixed[axis], double[axis])
    for k in range(1, 7):
        assert np.abs(fixed[f"q{k}"] - double[f"q{k}"]).max() < 2e-4
        assert 1e-4 < np.abs(fixed[f"q{k}"] - asked[f"q{k}"]).max() < 0.05


def test_intended_point_is_nominal_kinematics_in_the_fitted_base(fit: Path, tmp_path: Path) -> None:
    tables = tmp_path / "tables.bin"
    armtrue("export", fit, "--out", tables)
    armtrue("compensate", tables, poses(tmp_path / "poses.csv"), "--out", tmp_path / "c.csv")
    found, asked = read(tmp_path / "c.csv"), read(tmp_path / "poses.csv")
    exact = arms.simulated("kr30").with_terms([])
    joints = np.column_stack([asked[f"q{k}"] for k in range(1, 7)])
    wanted = exact.true_position(joints)
    assert np.abs(np.column_stack([found[a] for a in ("tx", "ty", "tz")]) - wanted).max() < 1e-7


@pytest.mark.full
def test_joints_beyond_their_limits_are_written_and_warned_of(fit: Path, tmp_path: Path) -> None:
    tables = tmp_path / "tables.bin"
    armtrue("export", fit, "--out", tables)
    table = poses(tmp_path / "poses.csv")
    inside = armtrue("compensate", tables, table, "--out", tmp_path / "c.csv")
    assert inside.stderr == ""
    limit = json.loads(fit.read_text())["robot"]["kinematics"]["joints"][1]["limits"][1]
    for name, row in (("poses.csv", 4), ("sent.csv", 5)):
        lines = (tmp_path / "poses.csv").read_text().splitlines()
        cells = lines[row].split(",")
        lines[row] = ",".join([cells[0], f"{limit + (row - 4) * 1e-3:.9f}", *cells[2:]])
        (tmp_path / name).write_text("\n".join(lines) + "\n")
    figures = tmp_path / "c.json"
    for engine in ("fixed", "double"):
        run = armtrue(
            *("compensate", tables, tmp_path / "sent.csv", "--engine", engine),
            *("--out", tmp_path / "c.csv", "--json", figures),
        )
        count = int(np.sum(read(tmp_path / "c.csv")["q2"] > limit))
        assert count in (1, 2)
        assert run.stderr.count("\n") == 1
        assert f"warning: {tmp_path / 'c.csv'}: {count} of " in run.stderr
        assert f"(joint 2 in {count}, 1 of them as commanded)" in run.stderr
        assert json.loads(figures.read_text())["rows_beyond_limits_by_joint"] == {"2": count}
    # Without the fit beside the table, the limits are not known.
    tables.with_name("tables.bin.fit.json").unlink()
    assert armtrue("compensate", tables, tmp_path / "sent.csv", "--out", tmp_path / "c.csv").stderr == ""


def test_increments_quantise_the_correction(fit: Path, tmp_path: Path) -> None:
    tables = tmp_path / "tables.bin"
    armtrue("export", fit, "--out", tables, "--increments", "36000")
    table = poses(tmp_path / "poses.csv")
    armtrue("compensate", tables, table, "--increments", "--out", tmp_path / "c.csv")
    change = (read(tmp_path / "c.csv")["q2"] - read(table)["q2"]) * 36000 / (2.0 * np.pi)
    assert np.abs(change - np.round(change)).max() < 1e-4
    assert np.abs(change).max() >= 1.0


def test_info_prints_the_whole_content(fit: Path, tmp_path: Path) -> None:
    tables = tmp_path / "tables.bin"
    armtrue("export", fit, "--out", tables, "--serial", "KR30-0815", "--sequence", "7")
    text = armtrue("tables", "info", tables, "--terms").stdout
    for word in (
        "KR30-0815",
        "sequence 7",
        "not signed",
        "q1, q2, q3",
        "6 × 6 × 6",
        "rounding",
        "motor3 +=",
        "sin(",
    ):
        assert word in text
    figures = json.loads(armtrue("tables", "info", tables, "--json", "-").stdout)
    assert figures["robot_serial"] == "KR30-0815"
    assert figures["bytes"] == tables.stat().st_size
    assert len(figures["tables"]) == 9
    assert all(entry["quantisation_um"] < 0.2 for entry in figures["tables"])
    assert sum(figures["section_bytes"].values()) < figures["bytes"]


def test_quantisation_error_of_tables_is_within_infos_bound() -> None:
    """The bound is half a unit of the last place, at the tool."""
    arm = arms.full_arm("kr30")
    image = Image(export(arm, ExportOptions()).image)
    from armtrue.tables.image import describe

    said = {entry["coordinate"]: entry for entry in describe(image)["tables"]}
    for grid in image.grids():
        fitted = next(g for g in arm.grids if len(g.axes[0].nodes) == grid.values.shape[0] and
                      g.axes[0].variable == image.state_name(grid.axes[0][0]))  # fmt: skip
        largest = np.abs(fitted.values).argmax()
        unit = 2.0 ** np.round(np.log2(fitted.values[largest] / grid.values[largest, 0]))
        error = np.abs(grid.values[:, 0] * unit - fitted.values).max()
        bound = said[fitted.coordinate]["quantisation_um"]
        from armtrue.tables.image import lever_m

        assert error * 1e6 * lever_m(image, fitted.coordinate) <= 1.1 * bound + 1e-4


def test_signed_tables_are_bound_to_the_key(fit: Path, tmp_path: Path) -> None:
    key, tables = tmp_path / "mine.key", tmp_path / "tables.bin"
    armtrue("keygen", "--out", key)
    armtrue("keygen", "--out", tmp_path / "other.key")
    assert key.stat().st_mode & 0o077 == 0
    armtrue("keygen", "--out", key, status=2)  # never overwritten
    armtrue("export", fit, "--out", tables, "--sign", key)
    assert "signature right" in armtrue("tables", "info", tables, "--key", tmp_path / "mine.key.pub").stdout
    assert (
        "wrong signature"
        in armtrue("tables", "info", tables, "--key", tmp_path / "other.key.pub", status=2).stderr
    )


def test_openssl_verifies_the_signature(fit: Path, tmp_path: Path) -> None:
    """An independent verifier: the signature is Ed25519 of RFC 8032 over everything before it."""
    key, tables = tmp_path / "k", tmp_path / "tables.bin"
    armtrue("keygen", "--out", key)
    armtrue("export", fit, "--out", tables, "--sign", key)
    image = tables.read_bytes()
    (tmp_path / "message").write_bytes(image[:-68])
    (tmp_path / "signature").write_bytes(image[-68:-4])
    public = base64.b64decode((tmp_path / "k.pub").read_text().split()[1])
    (tmp_path / "key.der").write_bytes(bytes.fromhex("302a300506032b6570032100") + public)
    done = subprocess.run(
        ["openssl", "pkeyutl", "-verify", "-pubin", "-inkey", tmp_path / "key.der", "-keyform", "DER", "-rawin",
         "-in", tmp_path / "message", "-sigfile", tmp_path / "signature"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_single_byte_corruption_and_truncation_is_refused() -> None:
    image = export(arms.full_arm("scara"), ExportOptions(secret_seed=bytes(range(32)))).image
    assert validate(image).accepted
    for at in range(len(image)):
        bad = bytearray(image)
        bad[at] ^= 0x55
        assert not validate(bytes(bad)).accepted, at
        assert not validate(image[:at]).accepted, at


def test_each_refusal_has_its_own_reason() -> None:
    image = export(arms.full_arm("kr30"), ExportOptions(serial="A-1")).image
    newer = bytearray(image)
    newer[4:6] = struct.pack("<H", layout.VERSION + 1)
    newer[-4:] = struct.pack("<I", zlib.crc32(newer[:-4]))
    reasons = {
        validate(image, serial="A-2").reason,
        validate(image, joints=7).reason,
        validate(bytes(newer)).reason,
        validate(image, public_key=bytes(32)).reason,
        validate(
            export(arms.full_arm("kr30"), ExportOptions(secret_seed=bytes(32))).image, public_key=bytes(32)
        ).reason,
        validate(image[:-1]).reason,
        validate(image[:50]).reason,
    }
    assert len(reasons) == 7
    assert "accepted" not in reasons
    assert validate(image, serial="A-1", joints=6).accepted


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Correct files, and files with one fault each."""
    folder = tmp_path_factory.mktemp("inputs")
    contents = {
        "FIT": arms.full_document("kr30").encode(),
        "OTHER": arms.full_document("kr30", seed=2).encode(),
        "SHORT": b"q1,q2,q3,q4,q5\n0,0,0,0,0\n",
        "TABLES": b"",
        "CUT": b"",
        "FLIPPED": b"",
    }
    named = {name: folder / name.lower() for name in contents}
    for name, content in contents.items():
        named[name].write_bytes(content)
    armtrue("export", named["FIT"], "--out", named["TABLES"])
    image = named["TABLES"].read_bytes()
    named["CUT"].write_bytes(image[:1000])
    named["FLIPPED"].write_bytes(image[:500] + bytes([image[500] ^ 1]) + image[501:])
    return {**named, "POSES": poses(folder / "poses.csv")}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["export", "FIT", "--out", "OUT", "--tool", "nobody"], "--tool: found 'nobody'"),
        (["export", "FIT", "--out", "OUT", "--serial", "ß"], "--serial"),
        (["export", "FIT", "--out", "OUT", "--serial", "x" * 25], "24 printable ASCII"),
        (["export", "FIT", "--out", "OUT", "--increments", "1,2"], "--increments"),
        (["export", "FIT", "--out", "OUT", "--increments", "many"], "--increments"),
        (["export", "FIT", "--out", "OUT", "--sign", "SHORT"], "expected a secret key"),
        (["export", "POSES", "--out", "OUT"], "not JSON"),
        (["compensate", "FIT", "POSES", "--out", "OUT"], "expected a table image"),
        (["compensate", "NONE", "POSES", "--out", "OUT"], "no such file"),
        (["compensate", "TABLES", "NONE", "--out", "OUT"], "no such file"),
        (["compensate", "TABLES", "SHORT", "--out", "OUT"], "q6"),
        (
            ["compensate", "TABLES", "POSES", "--engine", "double", "--fit", "OTHER", "--out", "OUT"],
            "another fit",
        ),
        (["tables", "info", "CUT"], "wrong length"),
        (["tables", "info", "FLIPPED"], "wrong checksum"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_bad_input_gives_one_sentence_and_writes_nothing(
    arguments: list[str], words: str, inputs: dict[str, Path], tmp_path: Path
) -> None:
    named = {**inputs, "NONE": tmp_path / "none", "OUT": tmp_path / "out"}
    said = armtrue(*[named.get(argument, argument) for argument in arguments], status=2)
    assert words in said.stderr
    assert said.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
