from socialiq.foreign import one_line


def test_escape_sequences_and_line_breaks_are_gone():
    assert one_line("red \x1b[31m\n next\tword\u202e") == "red [31m next word"


def test_bytes_that_are_no_text_are_readable():
    assert one_line(b"caf\xe9 \xff") == "caf\ufffd \ufffd"


def test_length_is_bounded():
    line = one_line("x" * 10**6, most=50)
    assert len(line) == 50 and line.endswith("…")
    assert one_line("x" * 50, most=50) == "x" * 50
