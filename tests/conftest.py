from collections.abc import Iterator

import jax
import pytest


@pytest.fixture(scope="session", name="compiled")
def compiled_folder(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(tmp_path_factory.mktemp("compiled"))


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
