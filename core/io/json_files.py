"""Text and JSON of untrusted files: any of the encodings that editors save, and values checked one by one."""

from __future__ import annotations

import codecs
import json
import math
from pathlib import Path

import numpy as np

from ..errors import ErrorCode, MirrorScanError

MAX_JSON_BYTES = 16_000_000
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


def text_of(data: bytes, errors: str = "replace") -> str:
    """Text as UTF-8, or as its byte order mark says: editors on Windows save UTF-16, and UTF-8 with a mark.

    UTF-16 without a mark is recognised by its first character, which in the files read here is an ASCII one.
    """
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return data.decode(encoding, errors)
    if len(data) > 3 and len(data) % 2 == 0 and 0 in data[:2] and data[:2] != b"\0\0":
        return data.decode("utf-16-le" if data[1] == 0 else "utf-16-be", errors)
    return data.decode("utf-8", errors)


def plain_text(data: bytes) -> bytes:
    """Text without a byte order mark, in UTF-8, for parsers of bytes; unchanged where it is so already."""
    if data.startswith(codecs.BOM_UTF8):
        return data[len(codecs.BOM_UTF8) :]
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return text_of(data).lstrip("\ufeff").encode()
    return data


def load_json(path: Path, error_type: type[MirrorScanError], code: ErrorCode) -> object:
    """Content of a JSON file.

    Raises
    ------
    MirrorScanError
        Of the given type and code, when it cannot be read or is no JSON.
    """
    try:
        if path.stat().st_size > MAX_JSON_BYTES:
            raise error_type(f"{path}: is far too large for what it should hold; is it the right file?", code=code)
        return json.loads(text_of(path.read_bytes(), "strict"))
    except OSError as error:
        raise error_type(
            f"{path}: cannot be read: {error.strerror or error}; choose another file", code=code
        ) from error
    except json.JSONDecodeError as error:
        raise error_type(
            f"{path}: is not valid JSON (line {error.lineno}: {error.msg}); correct that line", code=code
        ) from error
    except (ValueError, RecursionError) as error:  # no text, endless digits, endless nesting
        raise error_type(f"{path}: is not valid JSON ({type(error).__name__}); write it again", code=code) from error


def number(value: object) -> float:
    """``value`` as float; NaN for what is no number (JSON's true is none either)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        real = float(value)
    except OverflowError:
        return math.nan
    return real if math.isfinite(real) else math.nan


def numbers(value: object, count: int) -> np.ndarray | None:
    """``value`` as ``count`` finite numbers, or None."""
    if not isinstance(value, list) or len(value) != count:
        return None
    array = np.array([number(v) for v in value])
    return array if np.isfinite(array).all() else None


def short(value: object) -> str:
    """``value`` as JSON of at most 60 characters, for messages."""
    text = json.dumps(value, ensure_ascii=True)
    return text if len(text) <= 60 else text[:57] + "..."
