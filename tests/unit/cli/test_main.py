import importlib.metadata
import re
import subprocess
import sys

import pytest

from socialiq.cli import commands
from socialiq.cli.commands import (
    COMMANDS,
    ELSEWHERE,
    GROUPS,
    command_class,
    declared_options,
    help_page,
)
from socialiq.cli.main import main, parse
from socialiq.cli.words import ALIASES, nearest_option
from socialiq_lab.registry import STUDIES, declaration

HEAVY = ("jax", "numba", "scipy", "matplotlib", "equinox")


def run(capsys, *words):
    """Run a command line that ends in a help page or a mistake; status, output and complaint."""
    try:
        status = main(list(words))
    except SystemExit as stop:
        status = stop.code or 0
    shown = capsys.readouterr()
    return status, shown.out, shown.err


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_found_and_the_help_page_has_its_docstring(name, capsys):
    kind = command_class(name)
    assert (kind.__doc__ or "").startswith(commands.summary(name))
    status, out, _ = run(capsys, *name.split(), "--help")
    assert status == 0 and out.startswith(f"usage: socialiq {name} ")
    assert (kind.__doc__ or "").partition("\n")[0][:40] in out


def test_the_help_page_of_reproduce_lists_every_study_with_its_title(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    status, out, _ = run(capsys, "reproduce", "--help")
    assert status == 0
    lines = {words[0]: " ".join(words[1:]) for line in out.splitlines() if (words := line.split())}
    assert all(lines[name] == declaration(name)["title"] for name in STUDIES)


def test_the_top_page_lists_every_command(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "300")
    status, out, _ = run(capsys, "--help")
    assert status == 0
    assert out == help_page()
    lines = [" ".join(line.split()) for line in out.splitlines()]
    for name in COMMANDS:
        group, _, last = name.partition(" ")
        if group in GROUPS:
            [line] = (line for line in lines if line.lower().startswith(f"{group} {GROUPS[group]}"))
            assert last in line.partition(": ")[2].split(", "), name
        else:
            assert f"{name} {commands.summary(name)}" in lines
    ordered = ["for everyone:", "page", "for engineers:", "train", "for auditors:", "audit"]
    places = [next(i for i, line in enumerate(lines) if line.startswith(w)) for w in ordered]
    assert places == sorted(places)


@pytest.mark.parametrize("group", GROUPS)
def test_a_group_lists_its_commands_and_no_other(group, capsys):
    status, out, _ = run(capsys, group, "--help")
    assert status == 0
    lines = [line for line in out.splitlines() if line.startswith("  ") and line[2] != " "]
    assert [" ".join(line.split()[:2]) for line in lines] == [
        name for name in COMMANDS if name.startswith(f"{group} ")
    ]


@pytest.mark.parametrize("width", [40, 80, 120])
def test_help_pages_fit_the_terminal(width, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    assert max(map(len, help_page().splitlines())) <= width


def test_audit_keeps_its_policy_beside_audit_verify():
    from socialiq.cli.audit import Audit
    from socialiq.cli.audit_verify import Verify

    audit = parse(["audit", "idm", "--profile", "p.toml", "--out", "folder"])
    assert isinstance(audit, Audit) and audit.policy == "idm"
    assert isinstance(parse(["audit", "verify", "folder"]), Verify)


def test_version(capsys):
    status, out, _ = run(capsys, "--version")
    assert (status, out) == (0, f"socialiq {importlib.metadata.version('socialiq')}\n")


@pytest.mark.parametrize(
    ("words", "mend"),
    [
        (["train", "iq-learn", "d.safetensors", "--lambda", "1"], "did you mean --strength?"),
        (
            ["train", "iq-learn", "d.safetensors", "--lr=1e-4"],
            "--lr is a setting: give --set learning_rate=VALUE",
        ),
        (["train", "iq-learn", "d.safetensors", "--update", "7"], "did you mean --updates?"),
        (["train", "cql", "d.safetensors", "--batch-size", "8"], "give --set batch_size=VALUE"),
        (["train", "iq-lern", "d.safetensors"], "did you mean 'train iq-learn'?"),
        (["train"], "name a command of train: iq-learn"),
        (["evaluate", "go", "--num-episodes", "7"], "did you mean --episodes?"),
        (["evaluate", "go", "--environment", "crossing7"], "did you mean --world?"),
        (["audit", "go", "--svo", "3"], "socialiq audit --help lists the options"),
        (["solve", "crossing7", "--angel", "3"], "did you mean --angle?"),
        (["data", "import", "--most_state", "3"], "did you mean --most-states?"),
        (["trian"], "did you mean 'train'?"),
        (["data", "imprt"], "did you mean 'data import'?"),
        (["data-import"], "did you mean 'data import'?"),
        (["data"], "name a command of data: from-arrays"),
        ([], "name a command"),
        (["solve"], "socialiq solve --help"),
        (["solve", "crossing7", "--angle", "x"], "socialiq: --angle x: give a number\n"),
        (["quux"], "unknown command 'quux': socialiq --help lists the commands"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_near_word(words, mend, capsys):
    status, out, err = run(capsys, *words)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("socialiq: ") and mend in err


def test_options_are_read_from_sources_as_the_parser_has_them(capsys):
    for name, place in COMMANDS.items():
        with pytest.raises(SystemExit):
            parse([*name.split(), "--help"])
        page = capsys.readouterr().out
        shown = re.findall(r"^\W*(?:-\w, )?--([a-z][\w-]*(?:\.[\w-]+)*)", page, re.MULTILINE)
        assert {*declared_options(*place.split(":"))} == {*shown} - {"help"}, name


def test_a_mistyped_option_is_told_before_the_command_is_imported(capsys, monkeypatch):
    monkeypatch.delattr(commands, "command_class")
    said = run(capsys, "train", "dial", "--angel", "45")[2]
    assert said.startswith("socialiq: unknown option --angel: did you mean --angle? socialiq train")


def test_aliases_lead_to_options_or_settings():
    known = {name.replace("_", "-") for name in commands.learner_settings()}
    for place in COMMANDS.values():
        known |= {*declared_options(*place.split(":"))}
    for word, target in ALIASES.items():
        assert target in known, word
        assert word not in known, word


def test_a_missing_distribution_is_named(monkeypatch, capsys):
    own = {name: place for name, place in COMMANDS.items() if place.startswith("socialiq.")}
    elsewhere = {name for names in ELSEWHERE.values() for name in names}
    assert elsewhere == COMMANDS.keys() - own.keys()
    monkeypatch.setattr(commands, "COMMANDS", own)
    line = "socialiq data import needs socialiq-recordings: pip install socialiq-recordings\n"
    assert run(capsys, "data", "import", "x") == (2, "", f"socialiq: {line}")
    assert "socialiq claims needs socialiq-lab" in run(capsys, "claims")[2]


def test_the_last_part_of_a_nested_option_is_enough():
    assert nearest_option("lambda", ["config.strength", "angle"]) == "config.strength"
    assert nearest_option("zzz", ["config.strength"]) is None


def test_help_and_unknown_commands_import_nothing_heavy():
    """In one process that must not load a learner."""
    lines = [
        "import sys; from socialiq.cli.main import main; from socialiq.cli.commands import *",
        "help_page(); [help_page(group) for group in GROUPS]",
        "for word in ('trian', 'data', 'train'): assert main([word]) == 2",
        f"print([name for name in {HEAVY} if name in sys.modules])",
        "print([name for name in sys.modules if name.startswith('studies.')])",
    ]
    command = [sys.executable, "-c", "\n".join(lines)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]", "[]"]


def test_completion_knows_commands_of_two_words(capsys, tmp_path):
    status, out, _ = run(capsys, "completion", "bash")
    assert status == 0
    script = tmp_path / "completion.bash"
    script.write_text(out)
    lines = [
        f"source {script}",
        "COMP_WORDS=(socialiq {words}); COMP_CWORD={last}; _tyro_socialiq; echo ${{COMPREPLY[*]}}",
    ]
    for words, answer in {
        "data from-m": "from-minari",
        "train iq-learn --stren": "--strength",
        "audit ver": "verify",
    }.items():
        last = len(words.split())
        text = "\n".join(lines).format(words=words, last=last)
        done = subprocess.run(["bash", "-c", text], capture_output=True, text=True, check=True)
        assert done.stdout == f"{answer}\n"
    assert run(capsys, "completion", "zsh")[1].startswith("#compdef socialiq")
    said = "socialiq: shell fish: choose one of bash, zsh\n"
    assert run(capsys, "completion", "fish") == (2, "", said)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_no_words_of_the_parser(name, capsys):
    _, out, _ = run(capsys, *name.split(), "--help")
    text = " ".join(re.sub("[│╭╮╰╯─]", " ", out).split())
    for words in ("{None}", "options options", "(default: )", "(default: None)", "default: ''"):
        assert words not in text
