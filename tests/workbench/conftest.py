"""Simulated campaigns, the workbench as a process of its own, and a browser that reaches this machine alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import armtrue_sim
import pytest
from bench_page import Page
from opened import TWO_HIDDEN, Workbench

from tests.report.browser import Browser


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign")
    armtrue_sim.simulate(TWO_HIDDEN).write(folder)
    return folder


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    opened = Browser(this_machine=True)
    yield opened
    opened.close()


@pytest.fixture
def start(campaign: Path, tmp_path: Path) -> Iterator[Callable[..., Workbench]]:
    """Starts workbenches on the campaign, or on other arguments; all end with the test."""
    running: list[Workbench] = []

    def one(*arguments: str | Path) -> Workbench:
        own = [campaign / "data.csv", "--robot", campaign / "robot.yaml", "--model", campaign / "model.yaml"]
        running.append(Workbench(list(arguments) or own, tmp_path / "state"))
        return running[-1]

    yield one
    for workbench in running:
        workbench.kill()


@pytest.fixture
def workbench(start: Callable[..., Workbench]) -> Workbench:
    return start()


@pytest.fixture
def page(browser: Browser, workbench: Workbench) -> Page:
    return Page(browser, workbench.address)
