import io
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from socialiq.cli import output
from socialiq.cli.output import Display, fitted, rate_of
from socialiq.learners.callbacks import PARTS, Report

REPORT = Report(
    done=12_000,
    total=20_000,
    rate=1234.5,
    seconds_left=6.5,
    terms={"soft_bellman": -0.1234, "chi2": 0.987, "prior": 1.5, "max_q": 12.3},
    monitored={"greedy_angle": np.array([-42.27, 152.12])},
    failures=(),
)


def rendered(width, reports=(REPORT,), stage="reward_regularized 45 degrees"):
    console = Console(width=width, force_terminal=True, file=io.StringIO(), color_system=None)
    display = Display(console=console)
    show = display.stage(stage)
    for report in reports:
        show(report)
    with console.capture() as captured:
        console.print(display.progress)
    return captured.get().rstrip("\n")


@pytest.mark.parametrize("width", [40, 80, 120])
def test_stage_bar_rate_and_time_left_always_fit_one_line(width):
    line = rendered(width)
    assert "\n" not in line and len(line.rstrip()) <= width
    assert line.startswith("reward_reg") and "━" in line
    assert ("1,234 updates/s" if width >= 60 else "1,234/s") in line
    assert "6 s left" in line


def test_losses_are_shown_where_there_is_room():
    assert "soft_bellman" not in rendered(40)
    assert "chi2" not in rendered(80)
    wide = rendered(200)
    assert "soft_bellman -0.123 chi2 0.987 prior 1.5 max|Q| 12.3 α̂ -42.3° to 152.1°" in wide
    cut = rendered(120)
    assert "soft_bellman -0.123" in cut and "152.1" not in cut


@pytest.mark.parametrize("width", [40, 80, 120])
def test_a_stage_without_a_report_has_no_numbers(width):
    line = rendered(width, reports=())
    assert "None" not in line and "0/" not in line
    assert "starting" in line and len(line.rstrip()) <= width


def test_without_a_terminal_there_are_plain_lines(capsys, monkeypatch):
    monkeypatch.setattr(output, "time", SimpleNamespace(monotonic=lambda: 0.0))
    console = Console(width=80, file=io.StringIO())
    with Display(console=console) as display:
        show = display.stage("train")
        show(REPORT)
        show(REPORT)  # within ten seconds of the line before
        show(REPORT._replace(done=20_000, seconds_left=0.0))
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("train: 12000/20000, 1,234 updates/s, 6 s left, soft_bellman -0.123")
    assert lines[1].startswith("train: 20000/20000")
    assert "None" not in "".join(lines)


def test_a_quiet_display_says_nothing(capsys):
    with Display(quiet=True) as display:
        display.stage("train")(REPORT)
    assert capsys.readouterr() == ("", "")


def test_rates_keep_their_own_unit_of_time():
    jobs = REPORT._replace(rate=2.54, unit="jobs/min")
    assert (rate_of(jobs), rate_of(jobs, with_unit=False)) == ("2.5 jobs/min", "2.5/min")


def test_a_whole_run_counts_its_parts_and_the_time_that_is_left(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(output, "time", SimpleNamespace(monotonic=lambda: now[0]))
    parts = REPORT._replace(done=2, total=7, seconds_left=360.0, terms={}, monitored={}, unit=PARTS)
    log = Console(width=80, file=io.StringIO())
    terminal = Console(width=80, file=io.StringIO(), force_terminal=True)
    for console in (log, terminal):
        with Display(console=console) as display:
            show = display.stage("whole run")
            show(parts)
            display.progress.refresh()
            now[0] += 20.0
            show(parts._replace(done=7, seconds_left=0.0))
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["whole run: part 3 of 7, about 6 min left", "whole run: all 7 parts"]
    assert "part 3 of 7  about 6 min left" in terminal.file.getvalue()


def test_what_does_not_fit_is_left_out_whole():
    assert fitted(["ab 1", "cd 2", "e"], 9) == "ab 1 cd 2"
    assert fitted(["ab 1", "cd 2"], 8) == "ab 1"
    assert fitted(["ab 1"], -3) == ""
