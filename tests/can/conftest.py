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
# The suites' assertions are shown with their values, as those of test files are.
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
