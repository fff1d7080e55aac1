import pytest

WHOLE_RUNS = {"results", "work"}
"""Fixtures that run a whole study, at a tiny size."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        here = "unit/studies" in item.path.as_posix()
        if here and WHOLE_RUNS & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)
