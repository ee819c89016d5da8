"""Which tests every change runs, and which `./dev test full` alone."""

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark `full` what a parametrised test has beyond the cases that its mark `quick` names by their ids."""
    for item in items:
        quick = item.get_closest_marker("quick")
        case = getattr(item, "callspec", None)
        if quick is not None and (case is None or case.id not in quick.args):
            item.add_marker(pytest.mark.full)
