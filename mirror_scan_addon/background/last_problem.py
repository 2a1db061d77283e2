"""What went wrong last in this session, without anything that names a person, a place or a file."""

from __future__ import annotations

import errno
import re

from ...core.errors import MirrorScanError, Notice

_last: list[str] = []  # its lines; of the session, not of a file

PLACES = 4  # how many lines of our own code are told
_NUMBER = r"[-+−]?\d[\d.,×]*( ?(%|mm|cm|m|px|s|MB|GB|°))?"
_TRACE = r'File ".*?((?:core|mirror_scan_addon)[\\/][\w\\/]+\.py)", line (\d+), in (\w+)'


def remember(error: BaseException) -> None:
    """Keep an error until the next one."""
    _last[:] = describe(error)


def last() -> list[str]:
    """Lines that tell of the last error; none when nothing went wrong."""
    return list(_last)


def describe(error: BaseException) -> list[str]:
    """An error's kind, its text with every value but numbers left out, and where in our own code it was raised."""
    kind = type(error).__name__
    if isinstance(error, OSError) and error.errno is not None:
        kind += f" {errno.errorcode.get(error.errno, error.errno)}"
    text = ""
    if isinstance(error, MirrorScanError):
        text = without_names(error.notice)
    return [f"{kind}: {text}" if text else kind, *_places(error)]


def without_names(text: str) -> str:
    """A message as its template, numbers filled in; "" for one whose template is not known: it may hold anything."""
    if isinstance(text, Notice) and text.values:
        return _filled(text.template, text.values)
    from ..language.messages import recognise

    found = recognise(text)
    return "" if found is None else _filled(*found)


def _filled(template: str, values) -> str:
    """The values that are numbers, and those of our own words, at their places; "…" for the others."""
    kept = {}
    for name, value in values.items():
        if re.fullmatch(_NUMBER, value):
            kept[name] = value
        else:
            kept[name] = (without_names(value) if " " in value else "") or "…"
    return template.format(**kept)


def _places(error: BaseException) -> list[str]:
    """The innermost places in our own code, by the extension's folders; of a second process by its own account."""
    import traceback

    told = "".join(traceback.format_tb(error.__traceback__)) + str(error)
    places = [(path.replace("\\", "/"), line, name) for path, line, name in re.findall(_TRACE, told)]
    return [f"  {path}:{line} {name}" for path, line, name in places[-PLACES:]]
