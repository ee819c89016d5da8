"""The wheel in an empty environment: every command works without compiler, Debian packages or this checkout.

tools/test.d/45-wheel.full.sh builds it first.
"""

from __future__ import annotations

import re
import subprocess
import sys
import venv
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.full

ROOT = Path(__file__).resolve().parents[2]
# Libraries of every Linux of the wheel's age (the manylinux policies).
SYSTEM = {
    "libc.so.6",
    "libm.so.6",
    "libpthread.so.0",
    "libdl.so.2",
    "librt.so.1",
    "libgcc_s.so.1",
    "libstdc++.so.6",
}
Armtrue = Callable[..., str]


@pytest.fixture(scope="session")
def wheel() -> Path:
    built = list((ROOT / "dist").glob("armtrue-*.whl"))
    assert len(built) == 1, "dist holds no wheel, or several: ./dev wheel makes it"
    return built[0]


def environment_with(wheel: Path, folder: Path, *words: str | Path) -> Path:
    """Install the wheel and what it declares into a new environment; `words` are further arguments of pip."""
    venv.create(folder, with_pip=True)
    command = [folder / "bin/python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*command, "--use-pep517", *words, str(wheel)], check=True)
    return folder


@pytest.fixture(scope="session")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the versions of tools/requirements."""
    limits = ROOT / "tools/requirements/run.txt"
    return environment_with(wheel, tmp_path_factory.mktemp("environment"), "--constraint", limits)


@pytest.fixture(scope="session")
def armtrue(environment: Path, tmp_path_factory: pytest.TempPathFactory) -> Armtrue:
    return command_in(environment, tmp_path_factory.mktemp("work"))


def command_in(environment: Path, work: Path) -> Armtrue:
    """Runs the command in the folder `work`, with nothing else on the path."""

    def run(*words: str, status: int = 0) -> str:
        done = subprocess.run(
            [environment / "bin/armtrue", *words],
            cwd=work,
            env={"PATH": str(environment / "bin"), "HOME": str(work), "LANG": "C.UTF-8", "COLUMNS": "120"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout

    return run


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}


def test_wheel_is_manylinux_and_prints_its_version(wheel: Path, armtrue: Armtrue) -> None:
    assert re.fullmatch(r"armtrue-[\d.]+-cp311-cp311-manylinux[\w.]+\.whl", wheel.name)
    assert armtrue("--version") == f"armtrue {(ROOT / 'VERSION').read_text()}"


def test_wheel_works_with_the_newest_allowed_dependencies(wheel: Path, tmp_path: Path) -> None:
    # A user's pip installed a Typer without Click, and no command started.
    armtrue = command_in(environment_with(wheel, tmp_path / "environment"), tmp_path)
    assert "[rad, m]" in armtrue("export", "--help")
    armtrue("simulate", "kr30-eccentric-gear", "--out", "kr30")
    files = ["kr30/data.csv", "--robot", "kr30/robot.yaml", "--model", "kr30/model.yaml"]
    armtrue("fit", *files, "--out", "fit.json")
    armtrue("report", "fit.json", "--out", "report.html")
    armtrue("export", "fit.json", "--out", "tables.bin")
    assert "table format 1" in armtrue("tables", "info", "tables.bin")


def test_libraries_need_only_the_system_and_the_wheel(environment: Path) -> None:
    (package,) = environment.glob("lib/python3*/site-packages/armtrue")
    libraries = [*package.rglob("*.so*"), *package.parent.glob("armtrue.libs/*")]
    assert len(libraries) >= 3
    inside = {library.name for library in libraries}
    for library in libraries:
        said = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
        needed = set(re.findall(r"\(NEEDED\).*\[(.+)\]", said))
        assert needed <= SYSTEM | inside | {"ld-linux-x86-64.so.2"}, library.name


def test_notice_names_every_library_and_none_is_under_the_gpl(wheel: Path) -> None:
    held = contents(wheel)
    notice = (ROOT / "NOTICE").read_text()
    for name in held:
        if ".so" in Path(name).name:
            stem = re.split(r"[.-]", Path(name).name)[0]
            assert f"{Path(name).parent}/{stem}" in notice or f"armtrue/{stem}" in notice, name
    licences = {Path(name).name for name in held if "/licenses/" in name}
    assert {"LICENSE", "NOTICE", *(path.name for path in (ROOT / "licenses").iterdir())} <= licences
    (core,) = (content for name, content in held.items() if "/_core" in name and name.endswith(".so"))
    assert b"ceres" in core
    # In Debian's Ceres, CHOLMOD's supernodal modules are under the GPL and CXSparse is under the LGPL.
    assert b"cholmod_super" not in core
    assert b"cs_di_" not in core


def test_wheel_holds_data_and_no_tests(wheel: Path) -> None:
    names = set(contents(wheel))
    for name in (
        "armtrue/VERSION", "armtrue/py.typed", "armtrue/device/armtrue.eds", "armtrue/report/style.css",
        "armtrue/examples/kr30-eccentric-gear/data.csv", "armtrue_sim/scenarios/kr30.yaml",
    ):  # fmt: skip
        assert name in names
    assert [name for name in names if re.search(r"/(test_\w+|conftest)\.py$", name)] == []


def test_every_command_has_its_help(armtrue: Armtrue) -> None:
    groups: list[list[str]] = [[]]
    seen = 0
    while groups:
        group = groups.pop()
        listed = armtrue(*group, "--help").split("\nCommands:\n")[1]
        for name in re.findall(r"^  ([a-z]+)(?:  |$)", listed, flags=re.MULTILINE):
            text = armtrue(*group, name, "--help")
            seen += 1
            if "COMMAND [ARGS]" in text:
                groups.append([*group, name])
    assert seen >= 20


def test_workflow_from_simulation_to_corrected_commands_runs(armtrue: Armtrue) -> None:
    armtrue("simulate", "kr30-eccentric-gear", "--out", ".")
    armtrue("check", "data.csv", "--robot", "robot.yaml")
    armtrue("fit", "data.csv", "--robot", "robot.yaml", "--model", "model.yaml", "--out", "fit.json")
    assert "gear_harmonics" in armtrue("diagnose", "fit.json")
    armtrue("add", "fit.json", "gear_harmonics", "--joints", "3", "--out", "added.json")
    armtrue("remove", "added.json", "gear_harmonics", "--joints", "3", "--out", "removed.json")
    armtrue("compare", "added.json", "test.csv")
    armtrue("refine", "fit.json", "--out", "best.json")
    armtrue("predict", "best.json", "test.csv", "--out", "predicted.csv")
    armtrue("plan", "best.json", "--poses", "4", "--out", "poses.csv")
    armtrue("report", "fit.json", "best.json", "--out", "report.html")
    armtrue("export", "best.json", "--out", "tables.bin")
    armtrue("tables", "info", "tables.bin")
    armtrue("effects")
    armtrue("keygen", "--help")
    for engine in ("fixed", "double"):
        armtrue("compensate", "tables.bin", "test.csv", "--engine", engine, "--out", f"{engine}.csv")


def test_python_of_the_environment_is_not_the_checkouts(environment: Path) -> None:
    program = "import armtrue, armtrue_sim; print(armtrue.__file__, armtrue_sim.__file__)"
    done = subprocess.run(
        [environment / "bin/python", "-I", "-c", program], capture_output=True, text=True, check=True
    )
    assert all(path.startswith(str(environment)) for path in done.stdout.split())
    assert sys.prefix not in done.stdout
