"""The screen for a client on another computer: valid requests, GDI against a fake of Windows, libxcb against a real X server."""

import paths  # noqa: F401

import ctypes
import random
import shutil
import struct
import subprocess
import tempfile
import unittest
from pathlib import Path
from unittest import mock

from dtd_bridge import screen_gdi, screen_grab, screen_x11
from dtd_bridge.screen_grab import ScreenError


def noise(count):
    return random.Random(count).randbytes(count)


class PaperScreen:
    """Every part of it is as many bytes of its own as it needs."""

    def __init__(self, size=(40, 30)):
        self._size = size
        self.closed = False

    def size(self):
        return self._size

    def grab(self, x, y, width, height):
        return bytes([x, y, width]) * (width * height)

    def close(self):
        self.closed = True


class Asking(unittest.TestCase):
    def error(self, **request):
        header, payload = screen_grab.answer(PaperScreen(), {"message": "grab", **request})
        self.assertEqual((header["message"], payload), ("error", b""))
        return header["text"]

    def test_all_of_the_screen_or_a_part_of_it_comes_with_its_size(self):
        header, payload = screen_grab.answer(PaperScreen(), {"message": "grab"})
        self.assertEqual((header, len(payload)), ({"message": "grabbed", "width_px": 40, "height_px": 30}, 3_600))
        part = {"x_px": 8, "y_px": 20, "width_px": 32, "height_px": 10}
        header, payload = screen_grab.answer(PaperScreen(), {"message": "grab", **part})
        self.assertEqual((header["width_px"], payload), (32, bytes([8, 20, 32]) * 320))

    def test_a_part_that_is_none_or_outside_is_refused_with_the_screens_size(self):
        part = {"x_px": 8, "y_px": 20, "width_px": 32, "height_px": 10}
        for wrong in ({"x_px": 9}, {"y_px": 21}, {"width_px": 33}, {"height_px": 11}):
            self.assertIn("which has 40x30", self.error(**{**part, **wrong}))
        for wrong in ({"x_px": -1}, {"y_px": None}, {"width_px": 0}, {"height_px": 1 << 40}, {"x_px": 1.5}, {"x_px": True}):
            self.assertIn("expected a whole number", self.error(**{**part, **wrong}))
        self.assertIn("height_px is None", self.error(x_px=0, y_px=0, width_px=4))

    def test_another_message_and_a_screen_larger_than_the_link_are_refused(self):
        header, _ = screen_grab.answer(PaperScreen(), {"message": "freeze"})
        self.assertIn("expected grab", header["text"])
        header, _ = screen_grab.answer(PaperScreen((20_000, 9_000)), {"message": "grab"})
        self.assertIn("larger than what the link carries", header["text"])

    def test_systems_without_a_way_are_named_as_such(self):
        for system, has_one in (("win32", True), ("linux", True), ("darwin", False)):
            with mock.patch.object(screen_grab.sys, "platform", system):
                self.assertEqual(screen_grab.no_way_here() is None, has_one, system)
        with mock.patch.object(screen_grab.sys, "platform", "darwin"), self.assertRaisesRegex(ScreenError, "not of this system"):
            screen_grab.open_screen()


class Function:
    """A function of a library: it takes what it was declared for, and nothing before it was."""

    def __init__(self, does):
        self._does = does
        self.restype = self.argtypes = None

    def __call__(self, *arguments):
        if self.argtypes is None or len(arguments) != len(self.argtypes):
            raise TypeError(f"{len(arguments)} arguments, declared {self.argtypes}")
        for argument, kind in zip(arguments, self.argtypes):
            kind.from_param(argument)
        return self._does(*arguments)


class Library:
    pass


class PaperWindows:
    """A desktop whose top left is at (-10, -5), with one function that may fail; it knows which handles are out."""

    LEFT, TOP, WIDTH, HEIGHT = -10, -5, 32, 20

    def __init__(self, failing=None):
        self.failing = failing
        self.held = {}
        self.selected = {}
        self.last = 1 << 40  # A handle that 32 bits do not hold.
        self.bgrx = noise(self.WIDTH * self.HEIGHT * 4)
        self.awareness = []
        self.user32, self.gdi32 = Library(), Library()
        for library, names in ((self.user32, screen_gdi.USER32), (self.gdi32, screen_gdi.GDI32)):
            for name in names:
                setattr(library, name, Function(self._failing(name, getattr(self, name))))
        self.user32.SetThreadDpiAwarenessContext = Function(self.SetThreadDpiAwarenessContext)

    def screen(self):
        return screen_gdi.GdiScreen(self.user32, self.gdi32, lambda: 5)

    def _failing(self, name, function):
        return lambda *arguments: 0 if name == self.failing else function(*arguments)

    def _new(self, kind):
        self.last += 1
        self.held[self.last] = kind
        return self.last

    def SetThreadDpiAwarenessContext(self, context):
        # Windows 10 before 1703 knows the older one only.
        self.awareness.append(context)
        return 17 if context == -3 else None

    def GetSystemMetrics(self, metric):
        return {76: self.LEFT, 77: self.TOP, 78: self.WIDTH, 79: self.HEIGHT}[metric]

    def GetDC(self, window):
        assert window is None
        return self._new("desktop")

    def ReleaseDC(self, window, handle):
        assert self.held.pop(handle) == "desktop"
        return 1

    def CreateCompatibleDC(self, handle):
        assert self.held[handle] == "desktop"
        return self._new("memory")

    def CreateDIBSection(self, handle, info, colours, bits, section, offset):
        info = info._obj
        assert info.size == 40 and info.planes == 1 and info.bit_count == 32 and info.compression == 0 and info.height < 0
        self.bitmap_size = info.width, -info.height
        self.bitmap = ctypes.create_string_buffer(info.width * -info.height * 4)
        bits._obj.value = ctypes.addressof(self.bitmap)
        return self._new("bitmap")

    def SelectObject(self, memory, handle):
        before = self.selected.get(memory, 99)
        self.selected[memory] = handle
        return before

    def BitBlt(self, to, to_x, to_y, width, height, come_from, x, y, how):
        assert (to_x, to_y, how) == (0, 0, 0x40CC0020) and self.held[self.selected[to]] == "bitmap"
        assert (width, height) == self.bitmap_size and self.held[come_from] == "desktop"
        x, y = x - self.LEFT, y - self.TOP
        rows = ((row * self.WIDTH + x) * 4 for row in range(y, y + height))
        self.bitmap[: width * height * 4] = b"".join(self.bgrx[at : at + width * 4] for at in rows)
        return 1

    def GdiFlush(self):
        return 1

    def DeleteObject(self, handle):
        assert handle not in self.selected.values(), "still selected"
        assert self.held.pop(handle) == "bitmap"
        return 1

    def DeleteDC(self, handle):
        assert self.held.pop(handle) == "memory"
        return 1


class Gdi(unittest.TestCase):
    def test_a_part_of_a_desktop_that_begins_left_of_the_first_monitor_is_grabbed(self):
        windows = PaperWindows()
        screen = windows.screen()
        self.assertEqual(screen.size(), (32, 20))
        x, y, width, height = 3, 4, 11, 7
        expected = bytearray()
        for row in range(y, y + height):
            for column in range(x, x + width):
                blue, green, red, _ = windows.bgrx[(row * 32 + column) * 4 :][:4]
                expected += bytes((red, green, blue))
        for _ in range(3):
            self.assertEqual(screen.grab(x, y, width, height), expected)
        self.assertEqual(windows.held, {})
        self.assertEqual(windows.awareness, [-4, -3])

    def test_everything_is_given_back_whichever_call_fails(self):
        for name in ("GetDC", "CreateCompatibleDC", "CreateDIBSection", "SelectObject", "BitBlt"):
            windows = PaperWindows(failing=name)
            with self.assertRaisesRegex(ScreenError, f"{name}, error 5.*locked"):
                windows.screen().grab(0, 0, 8, 8)
            self.assertEqual(windows.held, {}, name)

    def test_a_session_without_a_desktop_and_an_old_windows_are_no_surprise(self):
        windows = PaperWindows(failing="GetSystemMetrics")
        del windows.user32.SetThreadDpiAwarenessContext
        with self.assertRaisesRegex(ScreenError, "no desktop"):
            windows.screen().size()


@unittest.skipUnless(shutil.which("Xvfb"), "no Xvfb")
class X11(unittest.TestCase):
    def server(self, form):
        """A display, and the file that its screen is."""
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        server = subprocess.Popen(
            ["Xvfb", "-displayfd", "1", "-screen", "0", form, "-noreset", "-nolisten", "tcp", "-fbdir", folder.name],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )
        self.addCleanup(server.stdout.close)
        self.addCleanup(server.wait)
        self.addCleanup(server.kill)
        return f":{server.stdout.readline().decode().strip()}", Path(folder.name) / "Xvfb_screen0"

    def test_a_part_of_what_lies_in_the_servers_memory_is_grabbed(self):
        display, memory = self.server("50x40x24")
        screen = screen_x11.open_x11(display)
        self.addCleanup(screen.close)
        self.assertEqual(screen.size(), (50, 40))
        # XWD: how long the header is, and how many colours of 12 bytes follow it.
        words = struct.unpack(">25I", memory.read_bytes()[:100])
        header, colours, row_bytes = words[0], words[19], words[12]
        self.assertEqual(row_bytes, 200)
        bgrx = noise(50 * 40 * 4)
        with memory.open("r+b") as file:
            file.seek(header + 12 * colours)
            file.write(bgrx)
        whole = screen.grab(0, 0, 50, 40)
        self.assertEqual(whole, b"".join(bgrx[at : at + 3][::-1] for at in range(0, len(bgrx), 4)))
        part = b"".join(whole[(row * 50 + 7) * 3 :][: 20 * 3] for row in range(9, 39))
        self.assertEqual(screen.grab(7, 9, 20, 30), part)

    def test_what_the_server_refuses_is_an_error_and_not_the_end_of_the_process(self):
        display, _ = self.server("50x40x24")
        screen = screen_x11.open_x11(display)
        self.addCleanup(screen.close)
        with self.assertRaisesRegex(ScreenError, "gives no image"):
            screen.grab(40, 30, 20, 20)
        self.assertEqual(len(screen.grab(0, 0, 50, 40)), 6_000)

    def test_a_display_that_is_not_there_or_has_other_pixels_is_refused_with_its_name_or_form(self):
        with self.assertRaisesRegex(ScreenError, "DISPLAY=':54321'"):
            screen_x11.open_x11(":54321")
        display, _ = self.server("50x40x16")
        with self.assertRaisesRegex(ScreenError, "16 bits.*24-bit colour"):
            screen_x11.open_x11(display)


if __name__ == "__main__":
    unittest.main()
