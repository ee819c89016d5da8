"""Every test in this folder runs where vcan0 and vcan1 exist; see sim/rig."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import canopen
import pytest

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(ROOT), str(ROOT / "sim"), str(HERE), str(HERE / "support"), str(HERE / "suites")]
# So that pytest shows the values in failed assertions of the suites, as it does in test files.
pytest.register_assert_rewrite("target", *(path.stem for path in (HERE / "suites").glob("suite_*.py")))

from node_process import NodeProcess, connect, disconnect  # noqa: E402
from rig.pytest_plugin import (  # noqa: E402
    can_buses,
    needs_can,
    pytest_collection_modifyitems,
    pytest_runtest_logreport,
    pytest_runtest_protocol,
)
from target import Target, start_target  # noqa: E402

__all__ = [
    "can_buses",
    "pytest_collection_modifyitems",
    "pytest_runtest_logreport",
    "pytest_runtest_protocol",
]

needs_can(__file__)

# Tests of the suites that every change runs on the emulated STM32F405: it answers, corrects and passes its self-test.
# The other tests are about the portable node, which the POSIX node runs; on chips they are marked `full`. So are those
# on the Cortex-R5F's bus: its emulator runs in User-Mode Linux (tests/firmware_boot boots its image with every change).
ON_THE_CHIP = {
    "test_sdo_01_expedited_read_of_1000h",
    "test_heartbeat_01_02_03_producer",
    "test_targets_are_corrected_by_the_table",
    "test_the_device_finds_itself_in_order",
}


def pytest_itemcollected(item: pytest.Item) -> None:
    target = getattr(item.module, "TARGET", "posix.toml")
    if not isinstance(item, pytest.Function) or target == "posix.toml":
        return
    from_a_suite = item.function.__module__ != item.module.__name__
    if target == "r5f.toml" or (from_a_suite and item.originalname not in ON_THE_CHIP):
        item.add_marker("full")


@pytest.fixture
def running_node(tmp_path: Path) -> Iterator[NodeProcess]:
    """An offset-mode node on vcan0, from factory state."""
    with NodeProcess(tmp_path / "state") as process:
        yield process


@pytest.fixture
def remote(running_node: NodeProcess) -> Iterator[canopen.RemoteNode]:
    """PyPI canopen's view of `running_node`."""
    node = connect(running_node.upstream)
    yield node
    disconnect(node)


@pytest.fixture(scope="module")
def target(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Target]:
    """The device that the test module's TARGET file describes, started once for the module."""
    with start_target(request.module.TARGET, tmp_path_factory.mktemp("state")) as running:
        yield running
