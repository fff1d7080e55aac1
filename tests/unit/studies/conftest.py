import pytest
from tests.digest.studies import run_here

from socialiq_lab import study
from socialiq_lab.engine import Engine

WHOLE_RUNS = {"results", "work"}
"""Fixtures that run a whole study, at a tiny size."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        here = "unit/studies" in item.path.as_posix()
        if here and WHOLE_RUNS & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(name="work", scope="module")
def work_folder(tmp_path_factory):
    """Folder of the jobs of `results`."""
    return tmp_path_factory.mktemp("study") / "work"


@pytest.fixture(name="results", scope="module")
def tiny_results(request, work):
    """Results of the module's STUDY with its configuration TINY."""
    module = request.module
    return study.run(module.STUDY, module.TINY, work=work, engine=Engine(processes=1))


@pytest.fixture(autouse=True, scope="package")
def without_processes():
    """Run the jobs in this process; `tests/unit/lab` tests the processes themselves."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "run_jobs", run_here)
        yield
