import gc
import os
import re
import signal
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

# XLA's older emitter of fused loops compiles in a third of the time. Without AVX-512, YNNPACK and
# oneDNN, which choose their instructions by the processor, sums have one order on all of them. Read
# when XLA starts, so all must be set before; processes that tests start inherit them.
os.environ["XLA_FLAGS"] = (
    f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_use_fusion_emitters=false --xla_cpu_max_isa=AVX"
    " --xla_cpu_experimental_ynn_fusion_type="
)
os.environ["TENSORFLOW_USE_CUSTOM_CONTRACTION_KERNEL"] = "false"
# XLA's number of threads, and with it the order of its sums: the same with one core and with many.
os.environ["NPROC"] = "1"
# NumPy computes alike on every processor. Read when NumPy is imported, which plugins of pytest do:
# it holds in pytest's workers, and in the processes that tests start.
os.environ["NPY_DISABLE_CPU_FEATURES"] = "X86_V4 AVX512_ICL"
os.environ["OPENBLAS_CORETYPE"] = "Haswell"

import jax
import jaxtyping
import pytest
from hypothesis import settings
from tests.patience import PATIENT

from socialiq.evaluation.parts import available_cores
from socialiq.worlds import registry
from socialiq.worlds.enumerate import Table, tabulate

# What is imported and collected stays: no collection of garbage looks at it (`gc.freeze` below).
gc.disable()
settings.register_profile("patient", PATIENT)
settings.load_profile("patient")

EXTRAS = Path(__file__).parent / "extras"
LONG = {"digest", "studies"}
"""Folders of the longest tests."""
EXCUSE = re.compile(r"needs (a GPU|Linux|macOS|Windows|two cores)")
"""Reasons that no installation removes. Any other fails a run with --report-skips."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--report-skips",
        metavar="FILE",
        help="append skipped tests to FILE; fail if it could have run on this machine",
    )


def pytest_configure() -> None:
    """Listen to Ctrl-C: a shell starts background jobs deaf to it, and processes inherit that."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.is_relative_to(EXTRAS):
            item.add_marker("extras")
        if item.get_closest_marker("two_cores") and available_cores() < 2:
            item.add_marker(pytest.mark.skip("needs two cores"))
    # Long tests first, or one worker would end with some of them while the other has none left.
    items.sort(key=lambda item: LONG.isdisjoint(item.path.parts))


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


def skipped(config: pytest.Config) -> list[tuple[str, str]]:
    """Each skipped test or module, and why."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    reports = reporter.stats.get("skipped", []) if reporter else []
    return [(one.nodeid, one.longrepr[2].removeprefix("Skipped: ")) for one in reports]


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Fail a run of --report-skips that left out what it could have run."""
    file = session.config.getoption("--report-skips")
    if file is None or "PYTEST_XDIST_WORKER" in os.environ:
        return
    found = skipped(session.config)
    with Path(file).open("a") as lines:
        lines.writelines(f"{name}: {reason}\n" for name, reason in found)
    if exitstatus == pytest.ExitCode.OK and not all(EXCUSE.search(why) for _, why in found):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    if config.getoption("--report-skips") is None:
        return
    for name, reason in skipped(config):
        if not EXCUSE.search(reason):
            terminalreporter.write_line(f"SKIPPED WITHOUT NEED {name}: {reason}", red=True)


@cache
def tabulated(name: str, **options: Any) -> Table:
    return tabulate(registry.make_grid(name, **options))


@pytest.fixture(name="tabulated", scope="session")
def tabulated_fixture() -> Callable[..., Table]:
    return tabulated


@pytest.fixture(scope="session")
def table5() -> Table:
    return tabulated("crossing5")


@pytest.fixture(scope="session")
def table7() -> Table:
    return tabulated("crossing7")


@pytest.fixture
def as_a_user_runs_it() -> Iterator[None]:
    """Disable run-time type checks, which users don't have and which refuse some mistakes first."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(name="each_once", scope="session")
def each_option_once() -> Callable[..., list[str]]:
    """Return a function that keeps of each option in words the last one, with its values."""

    def kept(*words: str) -> list[str]:
        groups: dict[str, list[str]] = {}
        option = ""
        for word in words:
            if word.startswith("--"):
                option = word
                groups[option] = []
            groups.setdefault(option, []).append(word)
        return [word for group in groups.values() for word in group]

    return kept


@pytest.fixture(scope="session", name="compiled", autouse=True)
def compiled_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Folder of compiled programs, for all workers and for the processes that tests start.

    Those compile fast rather than well, as `quick_compiler` does here. A folder that the
    environment names is used, so that two runs can share it.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder = os.environ.get("JAX_COMPILATION_CACHE_DIR", str(shared / "compiled"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAX_COMPILATION_CACHE_DIR", folder)
        patch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
        yield folder


@pytest.fixture(scope="module", autouse=True)
def quick_compiler(request: pytest.FixtureRequest, compiled: str) -> Iterator[None]:
    """Compile fast rather than well, and each program once in the whole run.

    The learners build their programs each time, and compiling them is most of the tests' time.
    A module whose training is long, or is compared with a committed one, sets
    `FULL_COMPILER = True`; it takes over no program that was compiled fast.
    """
    if getattr(request.module, "FULL_COMPILER", False):
        jax.clear_caches()
    settings = {
        "jax_compilation_cache_dir": compiled,
        "jax_persistent_cache_min_compile_time_secs": 0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
        "jax_disable_most_optimizations": not getattr(request.module, "FULL_COMPILER", False),
    }
    before = {name: jax.config.values[name] for name in settings}
    for name, value in settings.items():
        jax.config.update(name, value)
    yield
    for name, value in before.items():
        jax.config.update(name, value)
