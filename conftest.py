"""Marks the test cases that only `./dev test full` runs."""

from collections import defaultdict

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Of each test marked `quick`, mark as `full` the cases whose ids the mark does not name.

    If the mark names an id that no case has, the run ends with an error: otherwise `./dev test` would silently omit a
    case that was renamed.
    """
    unknown: dict[str, set[str]] = defaultdict(set)
    cases: dict[str, set[str]] = defaultdict(set)
    for item in items:
        if (quick := item.get_closest_marker("quick")) is None:
            continue
        case = item.callspec.id if hasattr(item, "callspec") else ""
        test = item.nodeid.partition("[")[0]
        unknown[test].update(quick.args)
        cases[test].add(case)
        if case not in quick.args:
            item.add_marker(pytest.mark.full)
    if any("::" in argument for argument in config.args):
        return  # single cases were requested, so a named case may be missing here
    for test, named in unknown.items():
        if missing := named - cases[test]:
            raise pytest.UsageError(f"{test}: quick names {sorted(missing)}, which no case has")
