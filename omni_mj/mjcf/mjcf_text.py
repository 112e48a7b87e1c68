"""Read and write MJCF as text, with comments, in the layout that MuJoCo Menagerie checks."""

import textwrap
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

INDENT = "  "
MAX_COLUMNS = 120
MAX_DIGITS = 9  # significant digits of numbers
_UNBROKEN_SPACE = "\0"  # in values, which remain on one line


def parse_mjcf(text: str) -> ElementTree.Element:
    """Return the root element of MJCF, with the comments below it."""
    builder = ElementTree.TreeBuilder(insert_comments=True)
    return ElementTree.fromstring(text, ElementTree.XMLParser(target=builder))


def format_mjcf(root: ElementTree.Element) -> str:
    """Return the text of MJCF: blank lines between elements, and line breaks of comments, remain.

    Numbers are rounded to `MAX_DIGITS`.
    """
    return "\n".join(_format_element(root, 0)) + "\n"


def format_numbers(*numbers: float) -> str:
    """Return numbers as the value of an attribute."""
    return " ".join(
        f"{number:.{MAX_DIGITS}g}" if abs(number) > 1e-15 else "0" for number in numbers
    )


def _format_element(element: ElementTree.Element, depth: int) -> Iterator[str]:
    """Yield the lines of an element."""
    indent = INDENT * depth
    if not isinstance(element.tag, str):  # a comment
        yield f"{indent}<!--{element.text}-->"
        return
    end = ">" if len(element) else "/>"
    yield from _format_tag(element, indent, end)
    space_before = element.text
    for child in element:
        if (space_before or "").count("\n") > 1:
            yield ""
        yield from _format_element(child, depth + 1)
        space_before = child.tail
    if len(element):
        yield f"{indent}</{element.tag}>"


def _format_tag(element: ElementTree.Element, indent: str, end: str) -> list[str]:
    """Return the lines of an element's opening tag, broken between attributes."""
    words = [f"<{element.tag}"]
    for name, value in element.attrib.items():
        rounded = _UNBROKEN_SPACE.join(map(_round_word, value.split()))
        words.append(f"{name}={quoteattr(rounded)}")
    lines = textwrap.wrap(
        " ".join(words) + end,
        MAX_COLUMNS,
        initial_indent=indent,
        subsequent_indent=indent + INDENT,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_UNBROKEN_SPACE, " ") for line in lines]


def _round_word(word: str) -> str:
    """Return a word, rounded if it is a number with too many digits or a whole one with ".0"."""
    if len(word) <= MAX_DIGITS + 2 and not word.endswith(".0"):
        return word
    try:
        return format_numbers(float(word))
    except ValueError:
        return word
