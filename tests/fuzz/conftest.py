"""Samples of all files, made once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import jaxtyping
import pytest
from tests.fuzz.run_calls import Runner
from tests.fuzz.samples import make_bad_places, make_samples


@contextmanager
def as_a_user() -> Iterator[None]:
    """Run without the checks of types at run time, which would refuse some mistakes first."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", before)


@pytest.fixture(autouse=True)
def as_a_user_runs_it() -> Iterator[None]:
    with as_a_user():
        yield


@pytest.fixture(scope="session")
def runner(tmp_path_factory: pytest.TempPathFactory) -> Runner:
    found = Runner(tmp_path_factory.mktemp("fuzz"))
    with as_a_user():
        make_samples(found.ok)
    make_bad_places(found.bad)
    found.keep()
    return found
