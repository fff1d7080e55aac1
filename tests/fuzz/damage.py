"""Damage to a valid file, drawn by hypothesis: of its bytes, of its words, of its content."""

from __future__ import annotations

import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from socialiq.storage import save_arrays

WORDS = (
    *("nan", "inf", "-inf", "1e400", "-1", "0", "1e-320", "1" * 31, "-" + "9" * 24, "0.5", "1e308"),
    *("", "null", "true", "[]", "{}", '""', '"x"', "[[[]]]", "NaN", "Infinity", "1_0", "0x1", "٣"),
    *("\u0000", "\ufeff", "\ud7ff", "\U0001f600", '"\\ud800"', "a" * 3000, "[" * 3000, "1.", "--"),
    *("1979-05-27", "9999-12-31T23:59:60", "2" * 400 + ".5", "&lt;", "<!DOCTYPE a>", "<a>", "]]>"),
    *("2147483648", "9223372036854775808", "18446744073709551616", "-2147483649", "'", '"', "\\"),
)
"""Words that a reader may meet in the place of another."""

TOKEN = re.compile(r'"[^"\n]*"|[-+\w.]+')

OBJECTS: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2**31, 2**63, 10**30, 0.5, -0.0, 1e308, "", "x", "nan", [], {}),
    *([[]], [0], [-1], ["x"], [None], {"a": 1}, [1e308], "a" * 5000, [0] * 2000, "\u0000", "../x"),
)
"""Values that a header may have in the place of another."""


@st.composite
def of_bytes(draw: st.DrawFn, content: bytes) -> bytes:
    """Bytes changed, removed, repeated, inserted or cut off."""
    made = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, max(len(made) - 1, 0)))
        length = draw(st.sampled_from((1, 1, 2, 4, 8, 64, 1000)))
        match draw(st.integers(0, 6)):
            case 0:
                made[place : place + 1] = draw(st.binary(min_size=1, max_size=1))
            case 1:
                del made[place : place + length]
            case 2:
                made[place:place] = made[place : place + length]
            case 3:
                made[place:place] = draw(st.binary(max_size=16))
            case 4:
                made[place : place + length] = draw(st.sampled_from((b"\xff", b"\x00"))) * length
            case 5:
                del made[place:]
            case _:
                other = draw(st.integers(0, max(len(made) - 1, 0)))
                made[place : place + length] = made[other : other + length]
    return bytes(made)


@st.composite
def of_words(draw: st.DrawFn, content: bytes) -> bytes:
    """Words, numbers, lines of a text replaced, removed or repeated."""
    text = content.decode("utf-8", "replace")
    for _ in range(draw(st.integers(1, 3))):
        if draw(st.integers(0, 3)) == 0:
            lines = text.split("\n")
            place = draw(st.integers(0, len(lines) - 1))
            times = draw(st.sampled_from((0, 2, 3, 50)))
            lines[place : place + 1] = [lines[place]] * times
            text = "\n".join(lines)
            continue
        found = list(TOKEN.finditer(text))
        if found:
            one = found[draw(st.integers(0, len(found) - 1))]
            word = draw(st.sampled_from(WORDS) | st.just(found[0][0]) | st.text(max_size=8))
            text = text[: one.start()] + word + text[one.end() :]
    return text.encode("utf-8", "replace")


@st.composite
def of_zip(draw: st.DrawFn, content: bytes) -> bytes:
    """A member of an archive damaged, removed, doubled, renamed, or as large as it says."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    place = draw(st.integers(0, len(members) - 1))
    name, inside = members[place]
    match draw(st.integers(0, 6)):
        case 0 | 1:
            members[place] = name, draw(of_bytes(inside))
        case 2:
            members[place] = name, draw(of_words(inside)) if len(inside) < 10**5 else inside
        case 3:
            del members[place]
        case 4:
            members.append((name, inside[: draw(st.integers(0, len(inside)))]))
        case 5:
            members[place] = draw(st.sampled_from(("", "../x", "x" * 300, "a\\b", "/x"))), inside
        case _:
            members[place] = name, inside + bytes(50_000_000)
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, data in members:
            archive.writestr(zipfile.ZipInfo(member or "empty"), data, zipfile.ZIP_DEFLATED)
    return made.getvalue()


@st.composite
def of_json(draw: st.DrawFn, content: bytes) -> bytes:
    """A value of a JSON document replaced by one of another type, removed, or nested deep."""
    document = json.loads(content)
    for _ in range(draw(st.integers(1, 2))):
        document = _changed(draw, document)
    return json.dumps(document).encode()


def _changed(draw: st.DrawFn, value: Any) -> Any:
    """Return a value with one place in it changed."""
    if isinstance(value, dict) and value and draw(st.integers(0, 9)):
        key = draw(st.sampled_from(sorted(value)))
        match draw(st.integers(0, 5)):
            case 0:
                return {name: one for name, one in value.items() if name != key}
            case 1:
                return {**value, draw(st.sampled_from(("", "x", "\u0000", "a" * 300))): value[key]}
            case _:
                return {**value, key: _changed(draw, value[key])}
    if isinstance(value, list) and value and draw(st.integers(0, 9)):
        place = draw(st.integers(0, len(value) - 1))
        return [*value[:place], _changed(draw, value[place]), *value[place + 1 :]]
    return draw(st.sampled_from(OBJECTS))


@st.composite
def of_content(
    draw: st.DrawFn,
    arrays: dict[str, np.ndarray],
    header: dict[str, Any],
    kind: str,
    version: int,
    path: Path,
) -> bytes:
    """Header or arrays changed, and the hash made again: only the reader's checks are left."""
    arrays, header = dict(arrays), dict(header)
    for _ in range(draw(st.integers(1, 2))):
        if header and draw(st.booleans()):
            header = _changed(draw, header)
            header = header if isinstance(header, dict) else {"x": header}
        elif arrays:
            name = draw(st.sampled_from(sorted(arrays)))
            made = _other_array(draw, arrays[name])
            if made is None:
                del arrays[name]
            else:
                arrays[name] = made
    save_arrays(path, kind, version, arrays, header)
    return path.read_bytes()


def _other_array(draw: st.DrawFn, array: np.ndarray) -> np.ndarray | None:
    match draw(st.integers(0, 7)):
        case 0:
            return None
        case 1:
            kind = draw(st.sampled_from(("f2", "f4", "f8", "i1", "i4", "i8", "u8", "?")))
            with np.errstate(all="ignore"):
                return array.astype(kind)
        case 2:
            return array.reshape(-1)[: draw(st.integers(0, 3))]
        case 3:
            return array[None]
        case 4:
            return np.concatenate([array.reshape(-1), array.reshape(-1)])
        case 5:
            return np.zeros((0, *array.shape[1:]), array.dtype)
        case _:
            flat = np.array(array).reshape(-1)
            if not flat.size or flat.dtype.kind == "b":
                return flat
            worst = (np.nan, np.inf, -np.inf, 1e308, -1.0, 0.0, 1e-320)
            ints = (-1, 0, 1, 2**31 - 1, -(2**31), 127)
            worst = worst if flat.dtype.kind == "f" else ints
            with np.errstate(all="ignore"):
                flat[draw(st.integers(0, flat.size - 1))] = np.array(
                    draw(st.sampled_from(worst))
                ).astype(flat.dtype)
            return flat.reshape(array.shape)
