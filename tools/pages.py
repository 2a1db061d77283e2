"""Help pages: the Markdown of README.md and docs/ as HTML files that a browser shows without a network.

    python tools/pages.py FOLDER

The extension ships them (``extension.py``). Understood is the Markdown that these files use: headings, paragraphs,
lists, tables, quotations, blocks of code, pictures, links, emphasis. Headings get the anchors that GitHub gives them.
Links to other files of the repository, which the extension does not ship, become plain text. What is not understood,
and a link or picture that leads nowhere, is an error.
"""

from __future__ import annotations

import argparse
import html
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCES = (ROOT / "docs" / "blender.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md")
NAMES = {source: f"{source.stem.lower()}.html" for source in SOURCES}
"""Source → file name of its page; the first in order is the one that help begins with."""

STYLE = """
body { font: 16px/1.55 system-ui, sans-serif; max-width: 52rem; margin: 0 auto; padding: 1rem 1.25rem 4rem;
       color: #222; background: #fff }
nav { font-size: 14px; border-bottom: 1px solid #ccc; padding-bottom: .5rem } nav a { margin-right: 1rem }
img { max-width: 100%; height: auto } a { color: #1a5fb4 }
pre { background: #f3f3f3; padding: .75rem; overflow-x: auto } code { background: #f3f3f3; font-size: 90% }
table { border-collapse: collapse; display: block; overflow-x: auto }
td, th { border: 1px solid #ccc; padding: .25rem .6rem; text-align: left; vertical-align: top }
blockquote { margin: 0; padding-left: 1rem; border-left: 3px solid #ccc }
@media (prefers-color-scheme: dark) {
  body { color: #ddd; background: #1e1e1e } a { color: #78aeed } pre, code { background: #2b2b2b }
  td, th, nav, blockquote { border-color: #555 } }
""".strip()

Link = Callable[[str], str | None]
"""Target as written → as the page has it; None for one that is not shipped."""

BEGINS = re.compile(r"```|#{1,4} |\||>|[-*] |\d+\. ")
"""How a line begins that ends a paragraph."""

ITEM = re.compile(r"(\s*)([-*]|\d+\.)\s+(.*)")
DIVIDER = re.compile(r"\|?\s*:?-+:?\s*(\|\s*:?-+:?\s*)*\|?\s*")


class PageError(Exception):
    """What in a file is not understood, or leads nowhere."""


def write_pages(folder: Path) -> list[Path]:
    """Write all pages and their pictures; returns every file of them, the pages first.

    Raises
    ------
    PageError
    """
    (folder / "images").mkdir(parents=True)
    pages, pictures = [], {}
    texts = {source: source.read_text(encoding="utf-8") for source in NAMES}
    anchors = {source: set(re.findall(r' id="([^"]*)"', "".join(blocks(text.splitlines(), lambda target: target))))
               for source, text in texts.items()}  # fmt: skip
    for source, text in texts.items():

        def link(target: str, source: Path = source) -> str | None:
            if re.match(r"https?://", target):
                return target
            file, _, anchor = target.partition("#")
            path = (source.parent / file).resolve() if file else source
            if not path.exists():
                raise PageError(f"{source.name}: {target}: there is no such file")
            if path.suffix in (".png", ".gif", ".svg", ".jpg"):
                pictures[path.name] = path
                return f"images/{path.name}"
            if path not in NAMES:
                return None
            if anchor and anchor not in anchors[path]:
                raise PageError(f"{source.name}: {target}: there is no such heading")
            return ("" if path == source else NAMES[path]) + (f"#{anchor}" if anchor else "") or NAMES[path]

        body = "\n".join(blocks(text.splitlines(), link))
        pages.append(folder / NAMES[source])
        pages[-1].write_text(_whole(text, body), encoding="utf-8")
    for name, path in pictures.items():
        shutil.copyfile(path, folder / "images" / name)
    return [*pages, *(folder / "images" / name for name in sorted(pictures))]


def _whole(text: str, body: str) -> str:
    entries = (
        f'<a href="{name}">{html.escape(_title(source.read_text(encoding="utf-8")))}</a>'
        for source, name in NAMES.items()
        if not name.startswith("figures")
    )
    return "\n".join((
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width">',
        f"<title>{html.escape(_title(text))}</title>\n<style>\n{STYLE}\n</style></head>\n<body>",
        "<nav>", *entries, "</nav>", body, "</body></html>\n",
    ))  # fmt: skip


def _title(text: str) -> str:
    return text.partition("\n")[0].lstrip("# ")


def blocks(lines: list[str], link: Link) -> Iterator[str]:
    """Lines of Markdown as pieces of HTML, in order."""
    at = 0
    while at < len(lines):
        line = lines[at]
        end = at + 1
        if not line.strip():
            pass
        elif line.startswith("```"):
            while end < len(lines) and not lines[end].startswith("```"):
                end += 1
            if end == len(lines):
                raise PageError(f"{line}: a block of code without an end")
            yield f"<pre><code>{html.escape(chr(10).join(lines[at + 1 : end]))}</code></pre>"
            end += 1
        elif found := re.match(r"(#{1,4}) (.*)", line):
            level, text = len(found[1]), found[2]
            yield f'<h{level} id="{slug(text)}">{inline(text, link)}</h{level}>'
        elif line.startswith("|") and end < len(lines) and DIVIDER.fullmatch(lines[end]):
            while end < len(lines) and lines[end].startswith("|"):
                end += 1
            yield from _table(lines[at:end], link)
        elif line.startswith(">"):
            while end < len(lines) and lines[end].startswith(">"):
                end += 1
            yield "<blockquote>"
            yield from blocks([inner[1:].removeprefix(" ") for inner in lines[at:end]], link)
            yield "</blockquote>"
        elif found := ITEM.match(line):
            while end < len(lines) and (not lines[end].strip() or lines[end].startswith(" ") or ITEM.match(lines[end])):
                end += 1
            yield from _list(lines[at:end], link)
        elif line.startswith(("<", "    ")) and not line.startswith("<a id="):
            raise PageError(f"not understood: {line}")
        else:
            while (
                end < len(lines) and lines[end].strip() and not re.match(r"```|#{1,4} |\||>|[-*] |\d+\. ", lines[end])
            ):
                end += 1
            yield f"<p>{inline(chr(10).join(lines[at:end]), link)}</p>"
        at = end


def _table(rows: list[str], link: Link) -> Iterator[str]:
    yield "<table>"
    columns = len(rows[1].strip().strip("|").split("|"))
    for number, row in enumerate(rows):
        if number == 1:
            continue
        # a bar in code is no border
        parts = re.split(r"\|(?=(?:[^`]*`[^`]*`)*[^`]*$)", row.strip().strip("|"))
        if len(parts) != columns:
            raise PageError(f"a table of {columns} columns has a row of {len(parts)}: {row}")
        kind = "td" if number else "th"
        yield "<tr>" + "".join(f"<{kind}>{inline(part.strip(), link)}</{kind}>" for part in parts) + "</tr>"
    yield "</table>"


def _list(lines: list[str], link: Link) -> Iterator[str]:
    first = ITEM.match(lines[0])
    kind = "ol" if first[2][0].isdigit() else "ul"
    items: list[list[str]] = []
    for line in lines:
        found = ITEM.match(line)
        if found and len(found[1]) == len(first[1]):
            items.append([found[3]])
            width = len(line) - len(found[3])
        else:
            items[-1].append(line[width:] if line[:width].isspace() else line.strip())
    yield f"<{kind}>"
    for item in items:
        inner = list(blocks(item, link))
        if inner[0].startswith("<p>"):  # tight: a browser would put space around it
            inner[0] = inner[0][3:-4]
        yield "<li>" + "\n".join(inner) + "</li>"
    yield f"</{kind}>"


def slug(text: str) -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", re.sub(r"[`*]", "", text).lower()).replace(" ", "-")


def inline(text: str, link: Link) -> str:
    """Text with code, pictures, links and emphasis in it."""
    kept: list[str] = []

    def keep(piece: str) -> str:
        kept.append(piece)
        return f"\0{len(kept) - 1}\0"

    text = re.sub(r"(`+)(.+?)\1", lambda m: keep(f"<code>{html.escape(m[2])}</code>"), text, flags=re.DOTALL)
    text = re.sub(r'<a id="([\w-]+)"></a>', lambda m: keep(f'<a id="{m[1]}"></a>'), text)
    text = html.escape(text, quote=False)

    def picture(found: re.Match) -> str:
        return keep(f'<img src="{link(found[2])}" alt="{html.escape(_bare(found[1], kept))}">')

    def reference(found: re.Match) -> str:
        target = link(html.unescape(found[2]))
        return found[1] if target is None else keep(f'<a href="{html.escape(target)}">') + found[1] + keep("</a>")

    text = re.sub(r"!\[([^\]]*)\]\(([^)\s]+)\)", picture, text)
    text = re.sub(r"\[([^\]]*)\]\(([^)\s]+)\)", reference, text)
    text = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", text, flags=re.DOTALL)
    text = re.sub(r"(?<![\w*])\*(?!\s)(.+?)(?<!\s)\*(?![\w*])", r"<em>\1</em>", text, flags=re.DOTALL)
    text = re.sub(r"\\([\\`*_|\[\]])", r"\1", text)
    text = re.sub(r"(  |\\)\n", "<br>\n", text)
    while "\0" in text:
        text = re.sub(r"\0(\d+)\0", lambda m: kept[int(m[1])], text)
    return text


def _bare(text: str, kept: list[str]) -> str:
    """Text for an attribute: code without its tags."""
    return html.unescape(re.sub(r"\0(\d+)\0", lambda m: re.sub(r"<[^>]*>", "", kept[int(m[1])]), text))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="new folder for the pages")
    options = parser.parse_args()
    try:
        print(f"{len(write_pages(options.folder))} files")
    except PageError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
