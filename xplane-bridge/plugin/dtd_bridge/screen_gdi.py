"""Windows' desktop, through GDI: as composed, so that Vulkan's output is included. (A window's own device context stays black
then.)"""

from __future__ import annotations

import ctypes
from contextlib import ExitStack
from ctypes import c_int, c_int32, c_uint, c_uint16, c_uint32, c_void_p
from typing import Any, Callable

from .screen_grab import Screen, ScreenError, rgb_of_bgrx

# GetSystemMetrics: the rectangle around all monitors.
SM_XVIRTUALSCREEN, SM_YVIRTUALSCREEN, SM_CXVIRTUALSCREEN, SM_CYVIRTUALSCREEN = 76, 77, 78, 79
# BitBlt: copy, and layered windows as well.
SRCCOPY, CAPTUREBLT = 0x00CC0020, 0x40000000
BI_RGB, DIB_RGB_COLORS = 0, 0
# SetThreadDpiAwarenessContext: physical pixels on each monitor; the second one is for Windows 10 before 1703.
PER_MONITOR_AWARE = (-4, -3)


class BitmapInfo(ctypes.Structure):
    """BITMAPINFOHEADER and one unused colour."""

    _fields_ = [
        ("size", c_uint32),
        ("width", c_int32),
        ("height", c_int32),
        ("planes", c_uint16),
        ("bit_count", c_uint16),
        ("compression", c_uint32),
        ("image_bytes", c_uint32),
        ("x_per_metre", c_int32),
        ("y_per_metre", c_int32),
        ("colours_used", c_uint32),
        ("colours_important", c_uint32),
        ("colours", c_uint32),
    ]


# Handles have 64 bits, which ctypes would truncate: each function with its result and its arguments.
USER32: dict[str, tuple[Any, ...]] = {
    "GetSystemMetrics": (c_int, c_int),
    "GetDC": (c_void_p, c_void_p),
    "ReleaseDC": (c_int, c_void_p, c_void_p),
}
GDI32: dict[str, tuple[Any, ...]] = {
    "CreateCompatibleDC": (c_void_p, c_void_p),
    "CreateDIBSection": (c_void_p, c_void_p, c_void_p, c_uint, c_void_p, c_void_p, c_uint32),
    "SelectObject": (c_void_p, c_void_p, c_void_p),
    "BitBlt": (c_int, c_void_p, c_int, c_int, c_int, c_int, c_void_p, c_int, c_int, c_uint32),
    "GdiFlush": (c_int,),
    "DeleteObject": (c_int, c_void_p),
    "DeleteDC": (c_int, c_void_p),
}


def open_gdi() -> Screen:
    """The desktop of this session."""
    load: Callable[..., Any] = ctypes.WinDLL  # type: ignore[attr-defined]
    last_error: Callable[[], int] = ctypes.get_last_error  # type: ignore[attr-defined]
    return GdiScreen(load("user32", use_last_error=True), load("gdi32", use_last_error=True), last_error)


class GdiScreen:
    """The whole desktop. No handles are held between two grabs."""

    def __init__(self, user32: Any, gdi32: Any, last_error: Callable[[], int]) -> None:
        self._user32, self._gdi32, self._last_error = user32, gdi32, last_error
        for library, functions in ((user32, USER32), (gdi32, GDI32)):
            for name, (result, *arguments) in functions.items():
                function = getattr(library, name)
                function.restype, function.argtypes = result, arguments
        _see_physical_pixels(user32)

    def size(self) -> tuple[int, int]:
        """Width and height of the rectangle around all monitors."""
        width, height = (self._user32.GetSystemMetrics(metric) for metric in (SM_CXVIRTUALSCREEN, SM_CYVIRTUALSCREEN))
        if width <= 0 or height <= 0:
            raise ScreenError("Windows says that there is no desktop: does X-Plane run in a session that somebody is logged in to?")
        return width, height

    def close(self) -> None:
        """There is nothing to release."""

    def grab(self, x: int, y: int, width: int, height: int) -> bytes:
        """A region of the desktop; its top left is that of the leftmost and topmost monitor, not of the first one."""
        left, top = (self._user32.GetSystemMetrics(metric) for metric in (SM_XVIRTUALSCREEN, SM_YVIRTUALSCREEN))
        gdi, bits = self._gdi32, c_void_p()
        # A negative height has the first row on top.
        info = BitmapInfo(ctypes.sizeof(BitmapInfo) - 4, width, -height, 1, 32, BI_RGB)
        # Handles are released in the opposite order, whatever fails in between.
        with ExitStack() as held:
            desktop = self._got("GetDC", self._user32.GetDC(None))
            held.callback(self._user32.ReleaseDC, None, desktop)
            memory = self._got("CreateCompatibleDC", gdi.CreateCompatibleDC(desktop))
            held.callback(gdi.DeleteDC, memory)
            bitmap = gdi.CreateDIBSection(desktop, ctypes.byref(info), DIB_RGB_COLORS, ctypes.byref(bits), None, 0)
            held.callback(gdi.DeleteObject, self._got("CreateDIBSection", bitmap))
            before = self._got("SelectObject", gdi.SelectObject(memory, bitmap))
            held.callback(gdi.SelectObject, memory, before)
            copied = gdi.BitBlt(memory, 0, 0, width, height, desktop, left + x, top + y, SRCCOPY | CAPTUREBLT)
            self._got("BitBlt", copied)
            # Until then the copy may still be in progress.
            gdi.GdiFlush()
            return rgb_of_bgrx(ctypes.string_at(self._got("CreateDIBSection", bits.value), width * height * 4))

    def _got(self, function: str, found: int | None) -> int:
        """The result of a function, checked for failure."""
        if found:
            return found
        raise ScreenError(
            f"Windows does not give its desktop ({function}, error {self._last_error()}): is the session locked, or a question of User Account "
            "Control open?"
        )


def _see_physical_pixels(user32: Any) -> None:
    """For the calling thread; otherwise a scaled desktop is seen in logical units. Windows before 10 has no such call."""
    set_awareness = getattr(user32, "SetThreadDpiAwarenessContext", None)
    if set_awareness is None:
        return
    set_awareness.restype, set_awareness.argtypes = c_void_p, [c_void_p]
    # Returns nothing if the context is unknown.
    any(set_awareness(context) for context in PER_MONITOR_AWARE)
