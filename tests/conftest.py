import os
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import jax
import pytest

from socialiq.worlds import registry
from socialiq.worlds.enumerate import Table, tabulate


@cache
def tabulated(name: str, **options: Any) -> Table:
    return tabulate(registry.make(name, **options))


@pytest.fixture(name="tabulated", scope="session")
def tabulated_fixture() -> Callable[..., Table]:
    return tabulated


@pytest.fixture(scope="session")
def table5() -> Table:
    return tabulated("crossing5")


@pytest.fixture(scope="session")
def table7() -> Table:
    return tabulated("crossing7")


@pytest.fixture(scope="session", name="compiled", autouse=True)
def compiled_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of compiled programs: one for all workers, and for the processes of jobs (`workers`).

    Those compile fast rather than well, as `quick_compiler` does here.
    """
    base = tmp_path_factory.getbasetemp()
    folder = str((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "compiled")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAX_COMPILATION_CACHE_DIR", folder)
        patch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
        yield folder


@pytest.fixture(scope="module")
def quick_compiler(compiled: str) -> Iterator[None]:
    """Compile fast rather than well, and runs of one structure once.

    The learners build their programs anew each time, and compiling them is most of the tests' time.
    """
    settings = {
        "jax_compilation_cache_dir": compiled,
        "jax_persistent_cache_min_compile_time_secs": 0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
        "jax_disable_most_optimizations": True,
    }
    before = {name: jax.config.values[name] for name in settings}
    for name, value in settings.items():
        jax.config.update(name, value)
    yield
    for name, value in before.items():
        jax.config.update(name, value)
