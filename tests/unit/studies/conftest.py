from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from socialiq.learners.callbacks import Report
from socialiq.results_folder import Results
from socialiq_lab import study
from socialiq_lab.jobs import Job, do, fingerprints, open_jobs

WHOLE_RUNS = {"results", "work"}
"""Fixtures that run a whole study, at a tiny size."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        here = "unit/studies" in item.path.as_posix()
        if here and WHOLE_RUNS & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(name="work", scope="module")
def work_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the jobs of `results`."""
    return tmp_path_factory.mktemp("study") / "work"


@pytest.fixture(name="results", scope="module")
def tiny_results(request: pytest.FixtureRequest, work: Path) -> Results:
    """Results of the module's STUDY with its configuration TINY."""
    return study.run(request.module.STUDY, request.module.TINY, work=work)


def run_here(
    jobs: Sequence[Job],
    work: Path,
    on_stage: Callable[[str], Callable[[Report], None] | None],
    *_engine: object,
) -> None:
    """Run the open jobs one by one in this process, which has its programs compiled already."""
    known = fingerprints(jobs)
    for job in open_jobs(jobs, work):
        on_stage(job.stage)
        do(job, work, known[job.name], lambda _: None)


@pytest.fixture(autouse=True, scope="package")
def without_processes() -> Iterator[None]:
    """Run the jobs here: two new processes for each study take most of a tiny one's time.

    The processes themselves are tested in `tests/unit/experiments`.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "run_jobs", run_here)
        yield
