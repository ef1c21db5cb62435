"""Reading, writing and waiting without giving up Python's interpreter lock.

XPPython3 4.7 keeps the lock between two callbacks, and X-Plane's own functions keep it as well: a plugin's threads run only while a
callback of Python runs, or waits. So the fake must not give the threads time of its own: ``ctypes.PyDLL`` calls the C library with the
lock held, as opposed to ``os.read`` or ``time.sleep``.
"""

from __future__ import annotations

import ctypes
import errno
import os
import time

_WINDOWS = os.name == "nt"
_C = ctypes.PyDLL("ucrtbase" if _WINDOWS else None, use_errno=True)
_READ, _WRITE = (_C._read, _C._write) if _WINDOWS else (_C.read, _C.write)
_READ.restype = _WRITE.restype = ctypes.c_int if _WINDOWS else ctypes.c_ssize_t
_READ.argtypes = _WRITE.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint if _WINDOWS else ctypes.c_size_t)
# The most that is read or written at once.
_CHUNK = 1 << 20


def pause(seconds: float) -> None:
    """Waits this long."""
    if seconds <= 0:
        return
    if _WINDOWS:
        ctypes.PyDLL("kernel32").Sleep(round(seconds * 1_000))
    else:
        _C.usleep(min(999_999, round(seconds * 1e6)))


def pause_until(deadline_s: float) -> None:
    """Waits until ``time.monotonic()`` reads this."""
    while (left_s := deadline_s - time.monotonic()) > 0:
        pause(left_s)


class HeldPipe:
    """Two file descriptors, to read from and to write to."""

    def __init__(self, read_from: int, write_to: int) -> None:
        self._read_from, self._write_to = read_from, write_to
        self._buffer = ctypes.create_string_buffer(_CHUNK)
        self._ahead = b""

    def write(self, content: bytes) -> None:
        """All of it; OSError if the other end is gone."""
        at = 0
        while at < len(content):
            part = content[at : at + _CHUNK]
            count = _WRITE(self._write_to, part, len(part))
            if count < 0 and ctypes.get_errno() != errno.EINTR:
                raise OSError(ctypes.get_errno(), "the pipe cannot be written to")
            at += max(0, count)

    def readline(self) -> bytes:
        """Up to the end of a line; empty if the other end is gone."""
        while b"\n" not in self._ahead:
            more = self._more()
            if not more:
                return b""
            self._ahead += more
        line, _, self._ahead = self._ahead.partition(b"\n")
        return line + b"\n"

    def read(self, count: int) -> bytes:
        """This many bytes; fewer if the other end is gone."""
        parts, have = [self._ahead], len(self._ahead)
        while have < count:
            more = self._more()
            if not more:
                break
            parts.append(more)
            have += len(more)
        everything = b"".join(parts)
        self._ahead = everything[count:]
        return everything[:count]

    def _more(self) -> bytes:
        while (count := _READ(self._read_from, self._buffer, _CHUNK)) < 0:
            if ctypes.get_errno() != errno.EINTR:
                raise OSError(ctypes.get_errno(), "the pipe cannot be read from")
        return self._buffer[:count]
