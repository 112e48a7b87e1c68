"""Text for a terminal: without control characters, and in the encoding of the terminal."""

import io
import re
import shlex
from collections.abc import Iterable

# Replacements of characters that an encoding may lack.
_ASCII = {"²": "^2", "°": "deg", "±": "+-", "\N{EN DASH}": "-", "∞": "inf"}


class PrintableOutput(io.TextIOWrapper):
    """Text output that escapes control characters and whatever its encoding lacks."""

    def write(self, text: str, /) -> int:
        """Write a text, and return its length before characters are replaced."""
        lines = text.split("\n")
        super().write("\n".join(to_encodable(line, self.encoding) for line in lines))
        return len(text)


def to_encodable(line: str, encoding: str) -> str:
    r"""Return a line with escapes or ASCII in place of characters that cannot be printed.

    The escapes are those of TOML, such as \u001b.
    """
    return "".join(c if c == "\t" else _replace_character(c, encoding) for c in line)


def format_count(n: int, noun: str) -> str:
    """Return a number with a noun, such as "1 row" or "2 rows"."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def join_words(words: Iterable[str]) -> str:
    """Return the words of a command as a line for a POSIX shell.

    Words with control characters are quoted as $'...', so the line stays a line and is printable.
    """
    return " ".join(
        shlex.quote(word) if word.isprintable() else _escape_word(word) for word in words
    )


def _replace_character(character: str, encoding: str) -> str:
    if character.isprintable():
        try:
            character.encode(encoding)
            return character
        except UnicodeEncodeError:
            if character in _ASCII:
                return _ASCII[character]
    code = ord(character)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _escape_word(word: str) -> str:
    """Return a word as $'...' with escapes for all but letters, digits and harmless marks."""
    escaped = re.sub(
        r"[^\w./:=,@%+-]",
        lambda match: "".join(
            f"\\x{byte:02x}" for byte in match[0].encode(errors="surrogateescape")
        ),
        word,
        flags=re.ASCII,
    )
    return f"$'{escaped}'"
