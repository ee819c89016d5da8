"""Commands whose output is an input, a device or a link, and options, names and file sizes that are impossible."""

from __future__ import annotations

import math
import os
import shlex
import shutil
import stat
import subprocess
import sys
import threading
from pathlib import Path

import click
import pytest
import typer
import yaml

from armtrue.cli.app import app
from armtrue.cli.conftest import armtrue
from armtrue.cli.shared.guard import GuardedGroup
from armtrue.errors import InputError
from armtrue.io import load_data, load_robot
from armtrue.io.files import write_file
from armtrue.io.yamlfile import load_yaml


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def refused(folder: Path, *arguments: str) -> str:
    """Run a command that must end with status 2 and change no file; return its one-line message."""
    before = contents(folder)
    run = armtrue(*arguments, cwd=folder)
    assert run.returncode == 2, run.stdout + run.stderr
    assert len(run.stderr.strip().splitlines()) == 1, run.stderr
    assert contents(folder) == before
    return run.stderr


@pytest.fixture(scope="module")
def exported(folder):
    assert armtrue("keygen", "--out", "k1", cwd=folder).returncode == 0
    run = armtrue("export", "fit.json", "--out", "t.bin", cwd=folder)
    assert run.returncode == 0, run.stderr
    (folder / "linked.csv").hardlink_to(folder / "data.csv")
    return folder


@pytest.mark.parametrize(
    "command",
    [
        "export fit.json --out k1 --sign k1",
        "export fit.json --out o.bin --json o.bin.fit.json",
        "export fit.json --out fit.json",
        "tables info t.bin --json t.bin",
        "tables info t.bin --key k1.pub --json k1.pub",
        "compensate t.bin test.csv --out c.csv --json t.bin.fit.json",
        "predict fit.json data.csv --out linked.csv",
        "compare fit.json test.csv --json test.csv",
        "remove fit.json joint_compliance --out data.csv",
        "check data.csv --robot robot.yaml --json robot.yaml",
    ],
)
def test_output_that_is_an_input_is_refused_before_writing(exported, command):
    assert "expected one" in refused(exported, *command.split())


@pytest.mark.parametrize(
    "command",
    [
        ("compensate", ".", "test.csv", "--out", "c.csv"),
        ("export", "fit.json", "--out", "."),
        ("keygen", "--out", ""),
        ("tables", "info", ""),
    ],
)
def test_folder_or_empty_name_in_place_of_a_file_is_refused(exported, command):
    assert "expected" in refused(exported, *command)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *(
            (option, value)
            for option in ("--max-rate", "--max-correction", "--damping")
            for value in ("nan", "inf", "1e300", "-1")
        ),
        ("--dead-band", "nan"),
        ("--payload-max", "-5"),
        ("--sequence", "4294967296"),
        ("--sequence", "-1"),
        ("--increments", "nan"),
        ("--increments", "0"),
        ("--increments", "1"),
        ("--increments", "15.9"),
        ("--increments", "2147483649"),
        ("--increments", "-15.9"),
        ("--increments", "-2147483649"),
        ("--damping", "1.1"),
    ],
)
def test_export_options_that_no_table_can_hold_are_refused_by_name(exported, option, value):
    assert option in refused(exported, "export", "fit.json", "--out", "o.bin", option, value)


def test_increments_of_wrong_count_or_size_name_the_limits(exported):
    export = ("export", "fit.json", "--out", "o.bin", "--increments")
    words = "expected 1 or 6 numbers from 16 to 2147483648, negative where a drive counts against its joint"
    assert f"found 1, {words}" in refused(exported, *export, "1")
    assert f"found 1000, 2000, {words}" in refused(exported, *export, "1000,2000")


@pytest.mark.quick("--increments=-16", "--sequence=4294967295")
@pytest.mark.parametrize(
    "option",
    [
        *(f"--increments={number}" for number in ("16", "2147483648", "-16", "-2147483648")),
        "--increments=-1000000,2000000,-3e6,4e6,5e6,6e6",
        "--sequence=2026112701",
        "--sequence=4294967295",
    ],
)
def test_export_accepts_the_extreme_valid_options(exported, tmp_path, option):
    run = armtrue("export", "fit.json", "--out", str(tmp_path / "o.bin"), option, cwd=exported)
    assert run.returncode == 0, run.stderr


def test_tool_name_is_refused_if_the_only_tool_has_no_name(exported):
    said = refused(exported, "export", "fit.json", "--out", "o.bin", "--tool", "nosuch")
    assert "--tool: found 'nosuch', expected none: the fit has one tool, which has no name" in said


def test_export_reports_options_that_the_firmware_limits(exported, tmp_path):
    options = ("--max-rate", "100", "--max-correction", "1", "--damping", "0.001")
    run = armtrue("export", "fit.json", "--out", str(tmp_path / "o.bin"), *options, cwd=exported)
    said = " ".join(run.stdout.split())
    assert "--max-rate 100 is cut to 0.628 rad/s on turning joints, the most that the firmware allows" in said
    assert "--max-correction 1 is cut to 0.314 rad on turning joints" in said
    assert "--damping 0.001 is raised to 0.00391 m/rad" in said
    run = armtrue("export", "fit.json", "--out", str(tmp_path / "o.bin"), cwd=exported)
    assert "firmware allows" not in run.stdout


@pytest.mark.quick("device monitor")
@pytest.mark.parametrize("command", ["device info", "device monitor", "device selftest", "upload t.bin"])
def test_nan_or_infinite_timeout_is_refused(exported, command):
    bus = ("--interface", "virtual", "--channel", "test", "--timeout")
    said = refused(exported, *command.split(), *bus, "nan")
    assert "--timeout: found nan, expected 0.05 to 60" in said
    assert "--timeout" in refused(exported, *command.split(), *bus, "inf")


def float_options():
    """Yield (command, option, count of numbers) for every option that takes floating-point numbers."""

    def under(command):
        if isinstance(command, click.Group):
            for own in command.commands.values():
                yield from under(own)
            return
        for parameter in command.params:
            kinds = parameter.type.types if isinstance(parameter.type, click.Tuple) else [parameter.type]
            if all(isinstance(kind, click.types.FloatParamType) for kind in kinds):
                yield command, parameter, len(kinds)

    root = typer.main.get_command(app)
    assert isinstance(root, GuardedGroup)
    yield from under(root.whole())


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_every_float_option_refuses_nan_and_infinity(value):
    options = list(float_options())
    assert len(options) > 15
    for command, parameter, count in options:
        context = click.Context(command)
        context.params = {parameter.name: value if count == 1 else (0.0,) * (count - 1) + (value,)}
        with pytest.raises(InputError, match=f"^{parameter.opts[0]}: found {value}, expected "):
            command.invoke(context)


@pytest.mark.quick("tables info t.bin --json -", "--help")
@pytest.mark.parametrize(
    "command",
    [
        "explain evidence",
        "effects",
        "tables info t.bin",
        "tables info t.bin --json -",
        "--help",
        "export --help",
    ],
)
def test_closed_output_pipe_ends_quietly_with_status_141(exported, command):
    """As with `armtrue … | head`: the reader of the pipe has ended."""
    read, write = os.pipe()
    os.close(read)
    try:
        run = subprocess.run(
            [sys.executable, "-m", "armtrue", *command.split()],
            cwd=exported,
            stdout=write,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
            check=False,
        )
    finally:
        os.close(write)
    assert (run.returncode, run.stderr) == (141, "")


def test_write_file_follows_links_and_writes_through_pipes(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "file").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real" / "file")
    write_file(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "file").read_text() == "new"
    os.mkfifo(tmp_path / "pipe")
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append((tmp_path / "pipe").read_text()))
    reader.start()
    write_file(tmp_path / "pipe", "through")
    reader.join(timeout=10)
    assert read == ["through"]
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_output_to_a_device_file_does_not_replace_it(folder):
    run = armtrue("predict", "fit.json", "test.csv", "--out", "/dev/null", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    run = armtrue("predict", "fit.json", "test.csv", "--out", "/dev/full", cwd=folder)
    assert run.returncode == 2
    assert "No space left" in run.stderr
    command = [sys.executable, "-m", "armtrue", "effects"]
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=120
        )
    assert ended.returncode == 2
    assert "Traceback" not in ended.stderr
    assert "No space left" in ended.stderr


@pytest.mark.parametrize(
    ("header", "name"),
    [
        ("temp_arm 1", "temp_arm_1"),
        ("temp_J1 (°C)", "temp_J1"),
        ("temp_arm-2", "temp_arm_2"),
        ("temp_arm", "temp_arm"),
    ],
)
def test_temperature_header_becomes_a_valid_expression_name(folder, tmp_path, header, name):
    text = (folder / "data.csv").read_text().replace("temp_arm", header, 1)
    (tmp_path / "data.csv").write_text(text)
    robot = load_robot(folder / "robot.yaml")
    assert name in load_data(tmp_path / "data.csv", robot).columns


def test_invalid_sensor_name_is_refused_with_a_valid_one(folder, tmp_path):
    robot = yaml.safe_load((folder / "robot.yaml").read_text())
    robot["temperature"]["sensors"] = ["arm 1"]
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    with pytest.raises(InputError, match="such as 'arm_1'"):
        load_robot(tmp_path / "robot.yaml")


@pytest.mark.parametrize("orders", ["[0]", "[1e300]", "[-1]"])
def test_impossible_gear_orders_are_refused(folder, orders):
    sentence = refused(
        folder,
        "add",
        "fit.json",
        "gear_mesh",
        "--joints",
        "1",
        "--option",
        f"orders={orders}",
        "--out",
        "o.json",
    )
    assert "orders" in sentence


def test_yaml_alias_bombs_and_alias_loops_are_refused(tmp_path):
    lines = ["a: &a [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
    (tmp_path / "bomb.yaml").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="aliases"):
        load_yaml(tmp_path / "bomb.yaml")
    (tmp_path / "loop.yaml").write_text("a: &a [*a]\n")
    with pytest.raises(InputError, match="aliases"):
        load_yaml(tmp_path / "loop.yaml")


def test_oversized_files_are_refused_before_reading(exported, tmp_path):
    shutil.copytree(exported, tmp_path / "in")
    with (tmp_path / "in" / "sparse.bin").open("wb") as stream:
        stream.truncate(20 * 1024**3)
    for command in (
        "tables info sparse.bin",
        "predict sparse.bin test.csv --out p.csv",
        "predict fit.json sparse.bin --out p.csv",
        "init sparse.bin --robot robot.yaml --out arm",
        "check sparse.bin --robot robot.yaml",
        "check data.csv --robot sparse.bin",
        "upload sparse.bin --interface virtual --channel test",
        "device verify sparse.bin --interface virtual --channel test",
    ):
        run = armtrue(*command.split(), cwd=tmp_path / "in")
        assert run.returncode == 2, (command, run.stdout, run.stderr)
        assert "sparse.bin" in run.stderr


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("d.yaml", 'file: "a\\0b"\n', "no file can have"),
        ("d.yaml", "file: data.csv\nencoding: utf-16\n", "utf-16"),
        ("d.yaml", "file: data.csv\nheader_row: " + "9" * 400 + "\n", "30 digits"),
    ],
)
def test_invalid_dataset_yaml_is_refused_in_one_sentence(folder, name, text, words):
    columns = ", ".join(f"{column}: {column}" for column in (*(f"q{k}" for k in range(1, 7)), *"xyz"))
    (folder / name).write_text(f"{text}columns: {{{columns}}}\n")
    assert words in refused(folder, "check", name, "--robot", "robot.yaml")


def test_number_of_6000_digits_in_a_fit_is_refused(folder):
    text = (folder / "fit.json").read_text().replace('"seed": 0', '"seed": ' + "7" * 6000)
    (folder / "long.json").write_text(text)
    said = refused(folder, "diagnose", "long.json")
    assert "long.json: found a number of more digits than can be read" in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--bitrate 0", "--bitrate: found 0"),
        ("--data-bitrate 0", "--data-bitrate: found 0"),
        ("--bus-option nonsense=1", "--bus-option: found 'nonsense'"),
    ],
)
def test_invalid_bus_options_are_refused_by_name(folder, options, words):
    command = f"device info --interface virtual --channel test {options}"
    assert words in refused(folder, *command.split())


def test_bus_option_without_a_value_is_refused(folder):
    command = "device info --interface virtual --channel test --bus-option foo"
    assert "KEY=VALUE" in refused(folder, *command.split())


def test_utf_16_without_byte_order_mark_is_named_and_init_reads_it(folder):
    (folder / "wide.csv").write_bytes((folder / "data.csv").read_text().encode("utf-16-le"))
    said = refused(folder, "check", "wide.csv", "--robot", "robot.yaml")
    assert "found UTF-16 text" in said
    run = armtrue(*shlex.split(said[said.index("armtrue init") :])[1:], cwd=folder)
    assert run.returncode == 0, run.stderr
    assert armtrue("check", "wide/dataset.yaml", "--robot", "wide/robot.yaml", cwd=folder).returncode == 0


def test_bytes_that_are_no_text_are_not_called_utf_16(folder):
    (folder / "binary.csv").write_bytes(b"\0\1PK\3\4" * 50)
    said = refused(folder, "check", "binary.csv", "--robot", "robot.yaml")
    assert "found bytes that are no text" in said
    assert "armtrue init" not in said, "it cannot read them either"


@pytest.mark.parametrize(
    ("typed", "meant"), [("diagnos", "diagnose"), ("chek", "check"), ("refien", "refine")]
)
def test_mistyped_command_suggests_the_nearest_one(folder, typed, meant):
    assert f"did you mean '{meant}'" in refused(folder, typed, "fit.json")


@pytest.mark.parametrize(
    ("command", "units"),
    [("export", ["[rad, m]", "[rad/s, m/s]", "[m/rad]", "[kg]"]), ("plan", ["[m]", "[m, robot base]"])],
)
def test_help_shows_units_in_square_brackets(folder, command, units):
    run = armtrue(command, "--help", cwd=folder)
    words = " ".join(run.stdout.replace("│", " ").split())
    for unit in units:
        assert unit in words
    assert "\\[" not in words
