"""Fixtures of tests of several pages."""

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module")
def browser() -> Iterator:
    from tests.extras.browsers import launched  # needs an extra

    with launched() as found:
        yield found
