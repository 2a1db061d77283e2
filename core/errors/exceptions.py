"""What can go wrong, reported in the user's words: what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Iterable

from .codes import CODES, ErrorCode
from .notices import Notice


class MirrorScanError(Exception):
    """Root of every error Mirror Scan raises on purpose; its text is shown to the user.

    Parameters
    ----------
    text : str
        A template with ``values``, as of :class:`.notices.Notice`; a plain text or a notice without.
    code : str, optional
        One of :data:`.codes.ErrorCode`: what kind of error it is, for programs. Without, an error that is quoted among
        the values or raised “from” gives its own, else the class does.
    mirrors, **values
        As of :class:`.notices.Notice`.
    """

    usual: ErrorCode = "other"
    """Code of an error of this class that has none of its own."""

    def __init__(
        self, text: str = "", /, *, code: ErrorCode | None = None, mirrors: Iterable[str] = (), **values: object
    ) -> None:
        if code is not None and code not in CODES:
            raise ValueError(f"there is no error code {code!r}")
        super().__init__(Notice(text, mirrors=mirrors, **values) if values or mirrors else Notice.of(text))
        quoted = (value.code for value in values.values() if isinstance(value, MirrorScanError))
        self._code = code or next(quoted, None)

    @property
    def notice(self) -> Notice:
        """The text with the parts it was made of."""
        return self.args[0]

    @property
    def code(self) -> ErrorCode:
        """What kind of error it is; it does not change with the words."""
        if self._code is not None:
            return self._code
        return self.__cause__.code if isinstance(self.__cause__, MirrorScanError) else self.usual

    def __reduce__(self) -> tuple:
        return _again, (type(self), self.notice, self.code)  # a cause is not pickled


def _again(kind: type[MirrorScanError], notice: Notice, code: ErrorCode) -> MirrorScanError:
    return kind(notice, code=code)


class CaptureError(MirrorScanError):
    """The capture cannot be read: a file is missing, truncated or of the wrong kind."""

    usual = "damaged"


class MirrorError(MirrorScanError):
    """A mirror cannot be placed: too few points, collinear points, points on no reading."""

    usual = "mirror"


class PicksDisagreeError(MirrorError):
    """The points picked on a mirror lie in no common plane."""


class ReconstructionError(MirrorScanError):
    """The capture was read, but no avatar can be made of what it shows."""


class OutputError(MirrorScanError):
    """A result cannot be written; nothing that existed was touched."""

    usual = "writing"
