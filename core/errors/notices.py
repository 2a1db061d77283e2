"""Messages to the user: English sentences that keep the parts they were made of.

A :class:`Notice` is a string and can be used wherever text is expected. It also knows which mirrors it is about, and
the template and values it was made of, so that it can be shown in another language.

Write a message as ``str.format`` takes it, its values by name::

    Notice("{name}: nobody is seen in this mirror", name=mirror.name, mirrors=[mirror.name])
    raise CaptureError("{path}: depth is {width}×{height} pixels", path=path, width=width, height=height)

instead of as an f-string. An f-string still works everywhere: it is plain text, which the add-on recognises by its
words (``mirror_scan_addon/language/messages.py``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from string import Formatter
from types import MappingProxyType

_FORMATTER = Formatter()


class Notice(str):
    """A message; it is its own English text, and equals and hashes as that. It does not change.

    Parameters
    ----------
    template : str
        For ``str.format``, with fields by name. A value that is needed in two formats goes by two names.
    mirrors : sequence of str
        Names of the mirrors it is about, in addition to those of notices among the values.
    **values : object
        One a field. A notice, or an error that carries one, keeps its parts; other values are kept as their text, in
        the field's format.

    Attributes
    ----------
    template : str
        Without the formats: ``{share}`` for ``{share:.0%}``. It is what translators translate.
    values : mapping of str to str or Notice
        ``template.format(**values)`` is the text.
    mirrors : tuple of str
    """

    __slots__ = ("mirrors", "template", "values")

    template: str
    values: Mapping[str, str]
    mirrors: tuple[str, ...]

    def __new__(cls, template: str, /, *, mirrors: Iterable[str] = (), **values: object) -> Notice:
        """Format the values into the template."""
        texts: dict[str, str] = {}
        for _, name, spec, conversion in _FORMATTER.parse(template):
            if name is not None:
                texts[name] = _as_text(values[name], spec or "", conversion)
        inner = [name for value in texts.values() if isinstance(value, Notice) for name in value.mirrors]
        bare = without_formats(template)
        made = super().__new__(cls, bare.format(**texts))
        object.__setattr__(made, "template", bare)
        object.__setattr__(made, "values", MappingProxyType(texts))
        object.__setattr__(made, "mirrors", tuple(dict.fromkeys((*mirrors, *inner))))
        return made

    @classmethod
    def of(cls, text: str, mirrors: Iterable[str] = ()) -> Notice:
        """A text as a notice: itself when it is one, else one without values. ``mirrors``: it is about these too."""
        made = text if isinstance(text, cls) else cls(str(text).replace("{", "{{").replace("}", "}}"))
        mirrors = [name for name in mirrors if name not in made.mirrors]
        return cls(made.template, mirrors=(*made.mirrors, *mirrors), **made.values) if mirrors else made

    def parts(self) -> dict:
        """All of it as JSON can hold it; :meth:`of_parts` makes it a notice again."""
        values = {name: value.parts() if isinstance(value, Notice) else value for name, value in self.values.items()}
        return {"template": self.template, "values": values, "mirrors": list(self.mirrors)}

    @classmethod
    def of_parts(cls, parts: dict) -> Notice:
        """A notice of what :meth:`parts` gave."""
        values = {k: cls.of_parts(value) if isinstance(value, dict) else value for k, value in parts["values"].items()}
        return cls(parts["template"], mirrors=parts["mirrors"], **values)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(name)  # neither the text nor its parts can be changed

    def __reduce__(self) -> tuple:
        return Notice.of_parts, (self.parts(),)


def without_formats(template: str) -> str:
    """The template with only the names left in its fields."""
    return "".join(
        literal.replace("{", "{{").replace("}", "}}") + ("" if name is None else f"{{{name}}}")
        for literal, name, *_ in _FORMATTER.parse(template)
    )


def _as_text(value: object, spec: str, conversion: str | None) -> str:
    value = getattr(value, "notice", value)  # an error's
    if isinstance(value, Notice) and not spec and not conversion:
        return value
    return format(_FORMATTER.convert_field(value, conversion), spec)
