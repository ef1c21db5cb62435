"""Images by X-Plane's screenshot command: complete files, of the right tick, from our camera, and none left behind."""

import paths  # noqa: F401

import struct
import tempfile
import unittest
import zlib
from pathlib import Path

from dtd_bridge import screenshots
from dtd_bridge.messages import Refusal
from fake_xp import png
from test_bridge import FREEZE, WithBridge, capture


def pixels(file):
    """Red, green, blue of a PNG without filters, and its kinds of chunks."""
    at, kinds, content = 8, [], b""
    while at < len(file):
        length, kind = struct.unpack_from(">I4s", file, at)
        kinds.append(kind)
        if kind == b"IDAT":
            content += file[at + 8 : at + 8 + length]
        at += 12 + length
    rows, row = zlib.decompress(content), 64 * 3 + 1
    return b"".join(rows[at + 1 : at + row] for at in range(0, len(rows), row)), kinds


class Screenshots(WithBridge):
    def setUp(self):
        super().setUp()
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.world.path = folder.name
        self.folder = Path(folder.name, "Output", "screenshots")

    def shot(self, client, tick):
        header, payload = client.ask(capture(tick, deliver="screenshot"))
        self.assertEqual(header["message"], "frame", header)
        return header, payload

    def test_the_picture_is_the_file_that_x_plane_wrote_and_none_is_left(self):
        client = self.frozen()
        for tick in (0, 1, 2):
            header, payload = self.shot(client, tick)
            self.assertEqual((header["tick"], header["width_px"], header["height_px"]), (tick, 64, 48))
            rgb, kinds = pixels(payload)
            # The text that X-Plane adds is gone: it differs from file to file.
            self.assertEqual(kinds, [b"IHDR", b"IDAT", b"IEND"])
            self.assertEqual(rgb[5], self.world.colour(), "the aircraft is where this tick has it")
            # A window of ours lies over the first pixel, the camera's heading is in the last one.
            self.assertEqual((rgb[:3], rgb[-2]), (b"\xff\x00\xff", 203))
        self.assertEqual(list(self.folder.iterdir()), [])
        self.assertGreater(self.world.lost_cameras, 0, "the camera was taken away, and taken back")

    def test_a_picture_of_the_tick_before_is_not_taken_for_the_new_one(self):
        self.world.lag_frames = 6
        client = self.frozen()
        for tick in (0, 1, 2):
            rgb, _ = pixels(self.shot(client, tick)[1])
            self.assertEqual(rgb[5], self.world.colour())

    def test_screenshots_that_do_not_show_our_camera_are_a_reason(self):
        self.xp.quirks |= {"screenshot_without_camera"}
        self.world.own_view = True
        client = self.frozen()
        self.assertRegex(client.refused(capture(deliver="screenshot")), "do not follow the camera.*--pixels screen")

    def test_a_camera_that_is_lost_at_the_command_is_a_reason(self):
        client = self.frozen()
        done = self.world.command
        self.world.command = lambda path: (done(path), path == screenshots.COMMAND and self.xp.steal_camera())
        self.assertRegex(client.refused(capture(deliver="screenshot")), "do not follow the camera")

    def test_a_new_client_proves_it_again(self):
        first = self.frozen()
        self.shot(first, 0)
        first.stream.close()
        second = self.another()
        self.assertEqual(second.ask({"message": "hello", "client": "test"})[0]["message"], "hello")
        second.ask(FREEZE)
        taken = self.world.commands.count(screenshots.COMMAND)
        self.shot(second, 1)
        first_time = self.world.commands.count(screenshots.COMMAND) - taken
        self.shot(second, 2)
        self.assertGreater(first_time, self.world.commands.count(screenshots.COMMAND) - taken - first_time)

    def test_files_of_the_user_stay_and_are_not_taken_for_ours(self):
        self.folder.mkdir(parents=True)
        mine = self.folder / "B738 - my holiday.png"
        mine.write_bytes(png(64, 48, bytes(64 * 48 * 3), b""))
        client = self.frozen()
        rgb, _ = pixels(self.shot(client, 0)[1])
        self.assertNotEqual(rgb, bytes(64 * 48 * 3))
        self.assertEqual(list(self.folder.iterdir()), [mine])

    def test_without_a_file_in_time_or_without_the_command_there_is_a_reason(self):
        self.patch(screenshots, FILE_LIMIT_S=0.2)
        client = self.frozen()
        self.xp._write_files = lambda: None
        self.assertRegex(client.refused(capture(deliver="screenshot")), "no screenshot into .*Output.*disk")
        self.world.known_commands.discard(screenshots.COMMAND)
        self.assertRegex(client.refused(capture(deliver="screenshot")), "does not know the command")
        self.assertEqual(client.ask({"message": "hello", "client": "test"})[0]["pixels"], ["gl", "screen"])


class Files(unittest.TestCase):
    def test_what_is_no_whole_picture_is_refused_or_waited_for(self):
        whole = png(4, 2, bytes(24), b"at noon")
        self.assertEqual(screenshots.parse(whole)[:2], (4, 2))
        self.assertEqual(screenshots.parse(whole)[2], screenshots.parse(png(4, 2, bytes(24), b"at one"))[2])
        for broken in (whole[:20], whole[:-1], whole[:8] + whole[33:], whole[:8] + b"\xff" * 40):
            with self.assertRaisesRegex(Refusal, "no sound PNG"):
                screenshots.parse(broken)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "shot.png")
            self.assertIsNone(screenshots._whole(path))
            path.write_bytes(whole[:-4])
            self.assertIsNone(screenshots._whole(path))
            path.write_bytes(whole)
            self.assertEqual(screenshots._whole(path), whole)


if __name__ == "__main__":
    unittest.main()
