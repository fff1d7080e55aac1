"""Tests mirror the source: each folder of tests/unit is a folder of src/socialiq."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCE, UNIT = ROOT / "src" / "socialiq", ROOT / "tests" / "unit"


def folders(root: Path) -> set[str]:
    """Folders with Python files, relative to the root."""
    return {str(path.parent.relative_to(root)) for path in root.rglob("*.py")}


def test_every_folder_of_tests_is_one_of_the_source():
    assert folders(UNIT) <= folders(SOURCE)


def test_every_package_has_tests():
    rooms = {path.name for path in SOURCE.iterdir() if (path / "__init__.py").is_file()}
    assert rooms <= {name.split("/")[0] for name in folders(UNIT)}
