import sys

import pytest

from socialiq.errors import UserError
from socialiq.foreign import Markdown, markdown, one_line, optional, templates


def test_escape_sequences_and_line_breaks_are_gone():
    assert one_line("red \x1b[31m\n next\tword\u202e") == "red [31m next word"


def test_bytes_that_are_no_text_are_readable():
    assert one_line(b"caf\xe9 \xff") == "caf\ufffd \ufffd"


def test_length_is_bounded():
    line = one_line("x" * 10**6, most=50)
    assert len(line) == 50 and line.endswith("…")
    assert one_line("x" * 50, most=50) == "x" * 50


def test_a_missing_extra_is_named_with_its_feature(monkeypatch):
    assert optional("json.decoder", "none", "tests").JSONDecoder
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(UserError, match=r"^ONNX files: onnx .* pip install 'socialiq\[onnx\]'$"):
        optional("onnx.helper", "onnx", "ONNX files")


def test_names_are_no_markup_and_markdown_stays():
    assert markdown("a_b |<i>`\n", 20) == "a\\_b \\|\\<i\\>\\` "
    assert markdown("x" * 30, 20) == "x" * 19 + "…"
    assert markdown(Markdown("**bold**"), 3) == "**bold**" and markdown(3, 1) == 3


def test_templates_escape_for_their_format():
    hostile = "<b> *x*"
    pages = [templates("socialiq.audit.report", most) for most in (0, 100)]
    found = [page.from_string("{{ name }}").render(name=hostile) for page in pages]
    assert found == ["&lt;b&gt; *x*", "\\<b\\> \\*x\\*"]
