"""The desktop of an X server, through libxcb. Not through Xlib, which ends the process on an error, and that is X-Plane."""

from __future__ import annotations

import ctypes
import os
from ctypes import POINTER, byref, c_char_p, c_int, c_int16, c_uint, c_uint8, c_uint16, c_uint32, c_void_p
from typing import Any

from .screen_grab import Screen, ScreenError, rgb_of_bgrx

Z_PIXMAP, ALL_PLANES = 2, 0xFFFFFFFF
LEAST_SIGNIFICANT_FIRST = 0
# The masks of red, green and blue in a pixel of four bytes, read as a number.
MASKS = (0xFF0000, 0xFF00, 0xFF)
# Answers begin with 32 bytes, more than is read here.
GEOMETRY_WIDTH_AT, GEOMETRY_HEIGHT_AT = 16, 18


class Setup(ctypes.Structure):
    """xcb_setup_t up to the needed fields."""

    _fields_ = [
        ("before", c_uint8 * 30),
        ("image_byte_order", c_uint8),
    ]


class ServersScreen(ctypes.Structure):
    """xcb_screen_t."""

    _fields_ = [
        ("root", c_uint32),
        ("before", c_uint32 * 4),
        ("width_px", c_uint16),
        ("height_px", c_uint16),
        ("between", c_uint16 * 4),
        ("root_visual", c_uint32),
        ("stores", c_uint8 * 2),
        ("root_depth", c_uint8),
        ("depths", c_uint8),
    ]


class Format(ctypes.Structure):
    """xcb_format_t."""

    _fields_ = [("depth", c_uint8), ("bits_per_pixel", c_uint8), ("scanline_pad", c_uint8), ("pad", c_uint8 * 5)]


class Visual(ctypes.Structure):
    """xcb_visualtype_t."""

    _fields_ = [("id", c_uint32), ("kind", c_uint32), ("masks", c_uint32 * 3), ("pad", c_uint32)]


def _iterator(of: Any) -> Any:
    """A list in an answer: the current item, and how many remain including it."""
    return type("Iterator", (ctypes.Structure,), {"_fields_": [("data", of), ("rem", c_int), ("index", c_int)]})


class Cookie(ctypes.Structure):
    """The cookie for a request's answer."""

    _fields_ = [("sequence", c_uint)]


Screens, Formats, Depths, Visuals = map(_iterator, (POINTER(ServersScreen), POINTER(Format), c_void_p, POINTER(Visual)))

# Each function with its result and its arguments.
XCB: dict[str, tuple[Any, ...]] = {
    "xcb_connect": (c_void_p, c_char_p, POINTER(c_int)),
    "xcb_connection_has_error": (c_int, c_void_p),
    "xcb_disconnect": (None, c_void_p),
    "xcb_get_setup": (POINTER(Setup), c_void_p),
    "xcb_setup_roots_iterator": (Screens, POINTER(Setup)),
    "xcb_screen_next": (None, POINTER(Screens)),
    "xcb_setup_pixmap_formats_iterator": (Formats, POINTER(Setup)),
    "xcb_format_next": (None, POINTER(Formats)),
    "xcb_screen_allowed_depths_iterator": (Depths, POINTER(ServersScreen)),
    "xcb_depth_next": (None, POINTER(Depths)),
    "xcb_depth_visuals_iterator": (Visuals, c_void_p),
    "xcb_visualtype_next": (None, POINTER(Visuals)),
    "xcb_get_geometry": (Cookie, c_void_p, c_uint32),
    "xcb_get_geometry_reply": (c_void_p, c_void_p, Cookie, c_void_p),
    "xcb_get_image": (Cookie, c_void_p, c_uint8, c_uint32, c_int16, c_int16, c_uint16, c_uint16, c_uint32),
    "xcb_get_image_reply": (c_void_p, c_void_p, Cookie, c_void_p),
    "xcb_get_image_data": (c_void_p, c_void_p),
    "xcb_get_image_data_length": (c_int, c_void_p),
}


def open_x11(display: str | None = None) -> Screen:
    """The screen of a display, or of the one that DISPLAY names."""
    try:
        xcb, libc = ctypes.CDLL("libxcb.so.1"), ctypes.CDLL(None)
    except OSError as error:
        raise ScreenError(f"there is no libxcb, through which the screen is grabbed: {error}") from error
    return X11Screen(xcb, libc.free, display)


class X11Screen:
    """The root window: everything visible."""

    def __init__(self, xcb: Any, free: Any, display: str | None) -> None:
        self._xcb, self._free = xcb, free
        free.restype, free.argtypes = None, [c_void_p]
        for name, (result, *arguments) in XCB.items():
            function = getattr(xcb, name)
            function.restype, function.argtypes = result, arguments
        number = c_int()
        self._connection = xcb.xcb_connect(display.encode() if display else None, byref(number))
        try:
            if xcb.xcb_connection_has_error(self._connection):
                name = display or os.environ.get("DISPLAY", "")
                raise ScreenError(f"the X server of DISPLAY={name!r} cannot be reached: does X-Plane run in an X11 session?")
            setup = xcb.xcb_get_setup(self._connection)
            roots = xcb.xcb_setup_roots_iterator(setup)
            for _ in range(number.value):
                xcb.xcb_screen_next(byref(roots))
            self._root = roots.data.contents.root
            self._check_form(setup, roots.data)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Disconnects from the X server."""
        if self._connection is not None:
            self._xcb.xcb_disconnect(self._connection)
            self._connection = None

    def size(self) -> tuple[int, int]:
        """Width and height of the root window now."""
        cookie = self._xcb.xcb_get_geometry(self._connection, self._root)
        reply = self._answered(self._xcb.xcb_get_geometry_reply(self._connection, cookie, None))
        try:
            width, height = (c_uint16.from_address(reply + at).value for at in (GEOMETRY_WIDTH_AT, GEOMETRY_HEIGHT_AT))
            return width, height
        finally:
            self._free(reply)

    def grab(self, x: int, y: int, width: int, height: int) -> bytes:
        """A region of the root window."""
        cookie = self._xcb.xcb_get_image(self._connection, Z_PIXMAP, self._root, x, y, width, height, ALL_PLANES)
        reply = self._answered(self._xcb.xcb_get_image_reply(self._connection, cookie, None))
        try:
            length, expected = self._xcb.xcb_get_image_data_length(reply), width * height * 4
            if length != expected:
                raise ScreenError(f"the X server sends {length} bytes for {width}x{height} pixels, expected {expected}")
            return rgb_of_bgrx(ctypes.string_at(self._xcb.xcb_get_image_data(reply), length))
        finally:
            self._free(reply)

    def _answered(self, reply: int | None) -> int:
        # libxcb discards unclaimed errors; they show as missing answers.
        if not reply:
            raise ScreenError("the X server gives no image: did the screen change its size, or the session end?")
        return reply

    def _check_form(self, setup: Any, screen: Any) -> None:
        """Rejects pixel formats other than four bytes with blue first."""
        xcb, depth = self._xcb, screen.contents.root_depth
        formats = xcb.xcb_setup_pixmap_formats_iterator(setup)
        bits = 0
        while formats.rem:
            if formats.data.contents.depth == depth:
                bits = formats.data.contents.bits_per_pixel
            xcb.xcb_format_next(byref(formats))
        masks = self._masks(screen)
        least_first = setup.contents.image_byte_order == LEAST_SIGNIFICANT_FIRST
        if bits != 32 or masks != MASKS or not least_first:
            raise ScreenError(
                f"the screen's pixels have {bits} bits with the masks {[hex(mask) for mask in masks]}, expected 32 bits and 8 each of red, "
                "green, blue: set it to 24-bit colour"
            )

    def _masks(self, screen: Any) -> tuple[int, ...]:
        """The masks of red, green and blue in the root window's pixels."""
        xcb = self._xcb
        depths = xcb.xcb_screen_allowed_depths_iterator(screen)
        while depths.rem:
            visuals = xcb.xcb_depth_visuals_iterator(depths.data)
            while visuals.rem:
                if visuals.data.contents.id == screen.contents.root_visual:
                    return tuple(visuals.data.contents.masks)
                xcb.xcb_visualtype_next(byref(visuals))
            xcb.xcb_depth_next(byref(depths))
        return ()
