"""The same as `socialiq.plain_text`, under the name it had."""

from socialiq.plain_text import one_line as one_line
