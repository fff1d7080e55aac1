"""Tests mirror the sources: each folder of tests/unit is a folder of a distribution or a study."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
UNIT = ROOT / "tests" / "unit"
SOURCES = {
    "": ROOT / "packages/socialiq/src/socialiq",
    "recordings": ROOT / "packages/socialiq-recordings/src/socialiq_recordings",
    "lab": ROOT / "packages/socialiq-lab/src/socialiq_lab",
    "studies": ROOT / "studies",
}


def folders(root: Path) -> set[str]:
    """Folders with Python files, relative to the root."""
    return {path.parent.relative_to(root).as_posix() for path in root.rglob("*.py")}


def test_every_folder_of_tests_is_one_of_the_sources():
    known = {
        (Path(name) / folder).as_posix()
        for name, source in SOURCES.items()
        for folder in folders(source)
    }
    assert folders(UNIT) <= known | {"studies"}


def test_every_package_has_tests():
    rooms = {path.name for path in SOURCES[""].iterdir() if (path / "__init__.py").is_file()}
    assert rooms <= {name.split("/")[0] for name in folders(UNIT)}
