"""Which tests every change runs, and which `./dev test full` alone."""

from collections import defaultdict

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Of a test marked `quick`, mark each case `full` whose id the mark does not name.

    An id that no case has ends the run, or a case that was renamed would silently leave `./dev test`.
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
        return  # only some cases were asked for: a named one may be among those that were not
    for test, named in unknown.items():
        if missing := named - cases[test]:
            raise pytest.UsageError(f"{test}: quick names {sorted(missing)}, which no case has")
