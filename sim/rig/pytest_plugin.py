"""Run a folder of tests where there is a bus, whatever machine pytest was started on.

A folder's conftest.py imports the fixture and the hooks of `__all__` and calls `needs_can` on itself.
With AF_CAN in the kernel the tests simply run. Without it, each module's tests run by a second pytest in a User-Mode
Linux of their own; the reports are replayed here one by one, so selection, failures, output and exit status are those
of an ordinary run. If the machine cannot be had, every selected test fails with the reason.

What machines side by side may not all build at once, a module's function BUILD_FIRST builds before they start.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from rig.buses import CanUnavailableError, ensure_buses, has_native_can
from rig.uml import run_in_uml

REPORTS_VARIABLE = "ARMTRUE_RIG_REPORTS"
TIMEOUT_VARIABLE = "ARMTRUE_RIG_TIMEOUT"
DEFAULT_TIMEOUT_S = 900.0
MACHINES_VARIABLE = "ARMTRUE_RIG_MACHINES"
DEFAULT_MACHINES = 4

_folders: set[Path] = set()
# What each test reported, and what to say if that was not all of it.
_replays: dict[str, tuple[list[dict[str, Any]], str]] = {}

__all__ = [
    "can_buses",
    "needs_can",
    "pytest_collection_modifyitems",
    "pytest_runtest_logreport",
    "pytest_runtest_protocol",
]


def needs_can(conftest: str) -> None:
    """Declare that all tests beside and below this conftest.py (its `__file__`) need the buses."""
    _folders.add(Path(conftest).resolve().parent)


def _is_ours(item: pytest.Item) -> bool:
    """Whether a test needs a bus: all of a declared folder but those marked `without_bus`."""
    inside = any(folder in item.path.parents for folder in _folders)
    return inside and item.get_closest_marker("without_bus") is None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what needs a bus, for `-m on_bus`."""
    for item in items:
        if _is_ours(item):
            item.add_marker("on_bus")


@pytest.fixture(scope="module", autouse=True)
def can_buses(request: pytest.FixtureRequest) -> None:
    """vcan0 and vcan1 are up for a module whose tests need them."""
    if request.node.get_closest_marker("without_bus") is None:
        ensure_buses()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Inside the rig: append each report to the file that the outer pytest reads."""
    path = os.environ.get(REPORTS_VARIABLE)
    if path is None:
        return
    with Path(path).open("a", encoding="utf-8") as file:
        file.write(json.dumps(report._to_json(), default=str) + "\n")


def _run_module(selected: list[str], root: Path, work: Path) -> tuple[dict[str, list[dict[str, Any]]], str]:
    """Run tests of one module in a machine of their own, with `work` as its scratch folder.

    Returns the reports by node id, and what to say of a test that has none. Raises CanUnavailableError with the
    inner pytest's own words if it ended before any test did.
    """
    work.mkdir()
    reports, arguments, log = work / "reports.jsonl", work / "selected", work / "log"
    arguments.write_text("\n".join(selected))
    pytest_command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--color=no"]
    pytest_command += [f"--rootdir={root}", f"--basetemp={work / 'tmp'}", f"@{arguments}"]
    command = ["bash", "-c", f"exec {shlex.join(pytest_command)} > {log} 2>&1"]
    timeout_s = float(os.environ.get(TIMEOUT_VARIABLE, DEFAULT_TIMEOUT_S))
    environment = {REPORTS_VARIABLE: str(reports), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    reason = "the run inside User-Mode Linux ended before this test reported"
    try:
        run_in_uml(command, timeout_s, environment)
    except TimeoutError as problem:
        reason = f"{problem}; the run had got so far:\n{log.read_text(errors='replace')}"
    if not reports.exists():
        raise CanUnavailableError(
            f"pytest inside User-Mode Linux ran no test:\n{log.read_text(errors='replace')}"
        )
    found: dict[str, list[dict[str, Any]]] = {}
    for line in reports.read_text(encoding="utf-8").splitlines():
        report = json.loads(line)
        found.setdefault(report["nodeid"], []).append(report)
    return found, reason


def _run_selected(session: pytest.Session) -> None:
    """Run every selected test that needs a bus, a machine for each module, several at a time.

    A machine has one processor and its own buses, and its tests mostly wait for each other's frames.
    """
    modules: dict[Path, list[str]] = {}
    for item in session.items:
        if not _is_ours(item):
            continue
        if item.path not in modules and isinstance(item, pytest.Function):
            getattr(item.module, "BUILD_FIRST", lambda: None)()
        modules.setdefault(item.path, []).append(item.nodeid)
    work = Path(tempfile.mkdtemp(prefix="armtrue-rig-reports-"))
    try:
        with ThreadPoolExecutor(int(os.environ.get(MACHINES_VARIABLE, DEFAULT_MACHINES))) as machines:
            longest_first = sorted(modules.values(), key=len, reverse=True)
            runs = [
                (
                    selected,
                    machines.submit(_run_module, selected, session.config.rootpath, work / str(number)),
                )
                for number, selected in enumerate(longest_first)
            ]
        for selected, run in runs:
            try:
                found, reason = run.result()
            except CanUnavailableError as problem:
                found, reason = {}, str(problem)
            for test in selected:
                _replays[test] = found.get(test, []), reason
    finally:
        shutil.rmtree(work)


def _failure(item: pytest.Item, reason: str) -> pytest.TestReport:
    return pytest.TestReport(item.nodeid, item.location, {}, "failed", reason, "call")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Outside the rig, on a kernel without CAN: replay what the test did inside."""
    if has_native_can() or not _is_ours(item):
        return None
    if not _replays:
        _run_selected(item.session)
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    found, reason = _replays[item.nodeid]
    reports = [pytest.TestReport._from_json(data) for data in found]
    if not any(report.when == "teardown" for report in reports):
        reports.append(_failure(item, reason))
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    # What a test outside set up for its folder ends here, if the next one is of another.
    item.session._setupstate.teardown_exact(nextitem)
    return True
