"""Hash of a policy that is code, and the files that it covers."""

import shutil
import sys
from pathlib import Path

import pytest

from socialiq import isolation as code_hash
from socialiq.errors import UserError
from socialiq.isolation import files_named_by, hash_files


def test_a_command_names_its_program_files_folders_and_options(tmp_path):
    (tmp_path / "model").write_text("m")
    (tmp_path / "folder").mkdir()
    model, folder = str(tmp_path / "model"), str(tmp_path / "folder")
    words = [
        "sh",
        "-c",
        "exit",
        model,
        f"--weights={model}",
        f"in={folder}",
        "--no=file",
        "x" * 5000,
    ]
    found = files_named_by(words, [folder])
    program = Path(str(shutil.which("sh")))
    assert found == [
        ("sh", program),
        (model, Path(model)),
        (f"--weights={model}", Path(model)),
        (f"in={folder}", Path(folder)),
        (folder, Path(folder)),
    ]
    # An empty word, or nothing after "=", does not name the present folder.
    assert [word for word, _ in files_named_by(["sh", "", "--model="])] == ["sh"]


def test_a_file_that_is_named_must_exist(tmp_path):
    for missing in (str(tmp_path / "missing"), ""):
        with pytest.raises(UserError, match="no such file"):
            files_named_by(["sh"], [missing])


def test_words_are_told_apart():
    texts = (["ab", "c"], ["a", "bc"], ["abc"], ["ab", "c", ""])
    assert len({hash_files(words, []).sha256 for words in texts}) == len(texts)


def test_everything_below_a_folder_counts(tmp_path):
    folder = tmp_path / "policy"
    (folder / "deep").mkdir(parents=True)
    (folder / "deep" / "weights").write_bytes(b"1")
    (folder / "link").symlink_to("deep/weights")

    def hashed():
        return hash_files([], files_named_by(["sh"], [str(folder)])).sha256

    seen = [hashed()]
    (folder / "empty").mkdir()
    seen.append(hashed())
    (folder / "link").unlink()
    (folder / "link").symlink_to("deep")
    seen.append(hashed())
    (folder / "deep" / "weights").write_bytes(b"2")
    seen.append(hashed())
    assert len(set(seen)) == len(seen)


def test_compiled_files_are_left_out_and_not_copied(tmp_path):
    folder = tmp_path / "policy"
    (folder / "__pycache__").mkdir(parents=True)
    named = files_named_by(["sh"], [str(folder)])
    before = hash_files([], named)
    (folder / "__pycache__" / "policy.pyc").write_bytes(b"compiled")
    copied = hash_files([], named, tmp_path)
    assert copied.sha256 == before.sha256
    assert list(copied.paths[folder].iterdir()) == []


def test_the_copy_has_exactly_the_hashed_bytes(tmp_path):
    folder, copies = tmp_path / "policy", tmp_path / "copies"
    (folder / "deep").mkdir(parents=True)
    copies.mkdir()
    (folder / "deep" / "weights").write_bytes(b"1")
    (folder / "link").symlink_to("deep/weights")
    (folder / "program").touch(mode=0o700)
    named = files_named_by(["no such"], [str(folder)])
    copied = hash_files([], named, copies)
    (folder / "deep" / "weights").write_bytes(b"2")
    copy = copied.paths[folder]
    assert (copy / "link").read_bytes() == b"1" and (copy / "link").is_symlink()
    assert (copy / "program").stat().st_mode & 0o777 == 0o755
    assert hash_files([], [(named[0][0], copy)]).sha256 == copied.sha256


@pytest.mark.parametrize("place", ["pyvenv.cfg", "lib/python3.11/os.py"])
def test_the_folder_of_another_python_is_hashed(tmp_path, place):
    """Attack: such a file beside a program made its whole folder visible, and nothing hashed it."""
    for name in ("bin/tool", "hidden", place):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch(mode=0o755)
    command = [str(tmp_path / "bin" / "tool")]
    before = hash_files(command, files_named_by(command)).sha256
    (tmp_path / "hidden").write_text("weights")
    assert hash_files(command, files_named_by(command)).sha256 != before


def test_a_link_that_leaves_its_folder_is_refused(tmp_path):
    folder = tmp_path / "policy"
    folder.mkdir()
    (tmp_path / "outside").write_text("x")
    (folder / "link").symlink_to("../outside")
    with pytest.raises(UserError, match="link is a link that leaves the policy's folder"):
        hash_files([], files_named_by(["sh"], [str(folder)]))


def test_what_is_no_plain_file_is_refused(tmp_path):
    import os

    folder = tmp_path / "policy"
    folder.mkdir()
    os.mkfifo(folder / "pipe")
    with pytest.raises(UserError, match="pipe is not a plain file"):
        hash_files([], files_named_by(["sh"], [str(folder)]))


def test_a_folder_with_too_many_files_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(code_hash, "MOST_FILES", 3)
    for number in range(3):
        (tmp_path / str(number)).touch()
    assert (
        "3 files (0 bytes)" in hash_files([], files_named_by(["no such"], [str(tmp_path)])).covers
    )
    (tmp_path / "3").touch()
    with pytest.raises(UserError, match="has more than 3 files: name the policy's own folder"):
        hash_files([], files_named_by(["no such"], [str(tmp_path)]))


def test_what_it_covers_is_told_in_words():
    text = hash_files([sys.executable], files_named_by([sys.executable])).covers
    assert text.startswith("the words, and whole the 1 files") and "shared libraries" in text
