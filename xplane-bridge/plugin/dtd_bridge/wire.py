"""Greeting and framing of the capture link: bytes <-> messages. No sockets, no X-Plane.

A message is two little-endian lengths, a JSON header and a payload. Lengths above a limit are rejected.
"""

from __future__ import annotations

import json
import math
import struct
from typing import Any, Callable

MAGIC = b"DTDL"
LINK_VERSION = 2
GREETING = MAGIC + struct.pack("<I", LINK_VERSION)
MAX_HEADER_BYTES = 64 << 10
MAX_PAYLOAD_BYTES = 192 << 20
# Levels of objects and lists in a header. Other parsers have limits as well, and a header may be sent on to another client.
MAX_DEPTH = 32
# Whole numbers beyond that cannot be read by every client.
MAX_WHOLE = 2**64 - 1

Header = dict[str, Any]
# Returns exactly this many bytes, or raises WireError if the other side closed.
ReadExactly = Callable[[int], bytes]


class WireError(Exception):
    """The other side does not speak this protocol; the text says how that shows."""

    repeats = False


class WrongToken(WireError):
    """The other side does not have the link's token, and will not have it the next time."""

    repeats = True


def check_greeting(greeting: bytes) -> None:
    """Raises WireError unless the eight bytes are those of this version."""
    if greeting[:4] != MAGIC:
        raise WireError(f"the other side greets with {greeting[:4]!r}, expected {MAGIC!r}: that is not a capture link")
    (version,) = struct.unpack("<I", greeting[4:8])
    if version != LINK_VERSION:
        raise WireError(
            f"the other side speaks version {version} of the capture link, expected {LINK_VERSION}: "
            "install the plugin and the program of the same release"
        )


def encode(value: Any) -> bytes:
    """JSON as in a header. Numbers keep all their digits; values that are not JSON numbers (NaN) are rejected with ValueError. Halves
    of surrogate pairs, which file names of X-Plane may contain, become question marks."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False, ensure_ascii=False).encode("utf-8", "replace")


def pack(header: Header, payload: bytes = b"") -> bytes:
    """One message. One that the other side would reject is rejected here, with ValueError."""
    text = encode(header)
    if len(text) > MAX_HEADER_BYTES:
        raise ValueError(f"the header has {len(text)} bytes, expected at most {MAX_HEADER_BYTES}")
    return struct.pack("<II", len(text), len(payload)) + text + payload


def check_sound(value: Any, depth: int = 0) -> None:
    """Raises ValueError unless every JSON parser reads a value alike: Python's also accepts NaN, numbers that are infinite, halves of
    surrogate pairs, and whole numbers of any size."""
    if depth > MAX_DEPTH:
        raise ValueError(f"it has more than {MAX_DEPTH} levels")
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError:
            raise ValueError("a text has half of a surrogate pair") from None
    elif isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"a number is {value}")
    elif isinstance(value, int):
        if abs(value) > MAX_WHOLE:
            raise ValueError(f"a whole number has {value.bit_length()} bits, expected at most 64")
    elif isinstance(value, dict):
        for key, item in value.items():
            check_sound(key, depth + 1)
            check_sound(item, depth + 1)
    elif isinstance(value, list):
        for item in value:
            check_sound(item, depth + 1)


def read_message(read_exactly: ReadExactly) -> tuple[Header, bytes]:
    """The next message."""
    header_bytes, payload_bytes = _read_lengths(read_exactly)
    header = _read_header(read_exactly, header_bytes)
    return header, read_exactly(payload_bytes)


def read_request(read_exactly: ReadExactly) -> Header:
    """The next message of a client, which has no payload: if one is announced, nothing of it is read."""
    header_bytes, payload_bytes = _read_lengths(read_exactly)
    if payload_bytes:
        raise WireError(f"a request has no payload, but {payload_bytes} bytes are announced")
    return _read_header(read_exactly, header_bytes)


def printable(text: str) -> str:
    """A client's text, for the log: on one line, without control characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text[:200])


def _read_lengths(read_exactly: ReadExactly) -> tuple[int, int]:
    header_bytes, payload_bytes = struct.unpack("<II", read_exactly(8))
    for part, announced, limit in (
        ("header", header_bytes, MAX_HEADER_BYTES),
        ("payload", payload_bytes, MAX_PAYLOAD_BYTES),
    ):
        if announced > limit:
            raise WireError(f"a {part} of {announced} bytes is announced, expected at most {limit}")
    return header_bytes, payload_bytes


def _read_header(read_exactly: ReadExactly, header_bytes: int) -> Header:
    text = read_exactly(header_bytes)
    try:
        header = json.loads(text)
        check_sound(header)
    except (ValueError, RecursionError) as error:
        raise WireError(f"the header is not JSON: {error}; it begins {text[:80]!r}") from error
    if not isinstance(header, dict) or not isinstance(header.get("message"), str):
        raise WireError(f"the header is no object with a message: it begins {text[:80]!r}")
    return header
