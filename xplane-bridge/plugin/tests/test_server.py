"""The link's sockets against hostile and silent clients."""

import paths  # noqa: F401

import errno
import socket
import struct
import threading
import unittest
from unittest import mock

from dtd_bridge import server, wire
from dtd_bridge.server import Asked, LinkServer, Note, Opened
from dtd_bridge.settings import Settings, SettingsError
from test_screen_grab import PaperScreen

HELLO = {"message": "hello", "client": "test"}
# Timeout of a test.
PATIENCE_S = 20.0


class WithServer(unittest.TestCase):
    def start(self, **settings):
        self.server = LinkServer(Settings(port=0, **settings))
        self.addCleanup(self.server.close)
        return self.server

    def connect(self):
        stream = socket.create_connection(("127.0.0.1", self.server.port))
        stream.settimeout(PATIENCE_S)
        self.addCleanup(stream.close)
        return stream

    def greet(self, header=HELLO):
        stream = self.connect()
        stream.sendall(wire.GREETING + wire.pack(header))
        return stream

    def wait_for(self, kind):
        while True:
            event = self.server.events.get(timeout=PATIENCE_S)
            if isinstance(event, kind):
                return event

    def all_of(self, stream):
        """What comes until the server closes."""
        received = b""
        while chunk := stream.recv(1 << 16):
            received += chunk
        return received

    def patch(self, **constants):
        for name, value in constants.items():
            patcher = mock.patch.object(server, name, value)
            patcher.start()
            self.addCleanup(patcher.stop)


class GivingTime(WithServer):
    """The main thread waits for the others only while they have something to do."""

    def test_a_frame_waits_as_long_as_bytes_of_a_request_are_not_read(self):
        self.patch(GIVE_TIME_S=PATIENCE_S)
        self.start()
        stream = self.greet()
        connection = self.wait_for(Opened).connection
        self.wait_for(Asked)
        waited = []
        sleep = server.time.sleep
        with (
            mock.patch.object(connection, "has_request", side_effect=[True, True, False]),
            mock.patch.object(server.time, "sleep", side_effect=lambda s: (waited.append(s), sleep(s))),
        ):
            self.server.give_time()
        self.assertEqual(len(waited), 2)
        stream.sendall(wire.pack({"message": "release"}))
        self.assertEqual(self.wait_for(Asked).header, {"message": "release"})

    def test_an_answer_is_on_its_way_before_the_frame_goes_on(self):
        self.patch(GIVE_TIME_S=PATIENCE_S)
        self.start()
        stream = self.greet()
        connection = self.wait_for(Opened).connection
        connection.answer({"message": "released"})
        connection.hand_over()
        self.assertTrue(connection._outbox.empty())
        self.assertEqual(stream.recv(8), wire.GREETING)

    def test_no_frame_waits_for_an_idle_client(self):
        self.start()
        self.greet()
        self.wait_for(Asked)
        with mock.patch.object(server.time, "sleep", side_effect=AssertionError("waits")):
            self.server.give_time()
            self.server.give_time()


class Silence(WithServer):
    def test_who_says_no_hello_does_not_hold_the_seat_and_leaves_in_time(self):
        self.patch(HELLO_TIMEOUT_S=0.3)
        self.start()
        silent = self.connect()
        half = self.connect()
        half.sendall(wire.GREETING + b"\x10")
        self.greet()
        self.wait_for(Opened)
        for stream in (silent, half):
            self.assertEqual(self.all_of(stream), wire.GREETING)

    def test_a_byte_now_and_then_wins_no_time(self):
        self.patch(HELLO_TIMEOUT_S=0.3)
        self.start()
        slow = self.connect()
        slow.settimeout(0.05)
        message = wire.GREETING + wire.pack({**HELLO, "long": "x" * 60_000})
        received = None
        for at in range(len(message)):
            try:
                slow.sendall(message[at : at + 1])
                received = slow.recv(1 << 10)
            except TimeoutError:
                continue
            except OSError:
                received = b""
            if received == b"":
                break
        self.assertEqual(received, b"")

    def test_a_hundred_and_twenty_idle_connections_keep_nobody_out(self):
        self.patch(HELLO_TIMEOUT_S=0.3)
        self.start()
        idle = [self.connect() for _ in range(120)]
        self.greet()
        self.wait_for(Opened)
        self.assertEqual(len(idle), 120)

    def test_a_silent_client_loses_its_seat_to_the_next_one(self):
        self.start()
        first = self.greet()
        self.wait_for(Asked).connection.answer({"message": "hello"})
        received = b""
        while not received.endswith(b"}"):
            received += first.recv(1 << 10)
        self.assertIn(b"hello", received)
        # It waits for nothing any more.
        self.patch(SILENCE_S=1e-6)
        self.greet()
        self.assertIsNotNone(self.wait_for(Opened))
        self.all_of(first)

    def test_a_client_that_waits_for_us_keeps_its_seat(self):
        self.start()
        self.greet()
        self.wait_for(Asked)
        self.patch(SILENCE_S=1e-6, SEAT_TIMEOUT_S=0.2)
        self.assertIn(b"another client holds", self.all_of(self.greet()))

    def test_a_client_that_takes_no_answers_gets_no_more_of_them_and_loses_its_seat(self):
        self.patch(MAX_QUEUED_BYTES=1 << 20)
        self.start()
        first = self.greet()
        connection = self.wait_for(Asked).connection
        self.assertTrue(connection.takes_more())
        first.sendall(wire.pack({"message": "release"}) * 3)
        for _ in range(3):
            self.wait_for(Asked)
        # More than the sockets' buffers hold.
        connection.answer({"message": "hello"}, bytes(32 << 20))
        self.assertFalse(connection.takes_more())
        self.patch(SILENCE_S=1e-6)
        self.greet()
        self.assertIsNotNone(self.wait_for(Opened))


class Screen(WithServer):
    """Connections for the screen, which take no seat."""

    def start(self, **settings):
        self.screens = []

        def open_screen():
            self.screens.append(PaperScreen())
            return self.screens[-1]

        patcher = mock.patch.object(server.screen_grab, "open_screen", open_screen)
        patcher.start()
        self.addCleanup(patcher.stop)
        return super().start(**{"token": "open sesame", "grab": True, **settings})

    def open(self, token="open sesame"):
        stream = self.greet({"message": "open_screen", "client": "test", "token": token})
        self.assertEqual(self.read(stream, 8), wire.GREETING)
        return stream

    def read(self, stream, count):
        received = b""
        while len(received) < count:
            chunk = stream.recv(count - len(received))
            if not chunk:
                raise EOFError
            received += chunk
        return received

    def answer(self, stream):
        return wire.read_message(lambda count: self.read(stream, count))

    def test_pictures_come_while_somebody_has_the_seat_and_the_main_thread_sleeps(self):
        self.start()
        self.greet({**HELLO, "token": "open sesame"})
        self.wait_for(Asked)
        stream = self.open()
        self.assertEqual(self.answer(stream)[0], {"message": "screen_opened", "width_px": 40, "height_px": 30})
        stream.sendall(wire.pack({"message": "grab"}) * 3 + wire.pack({"message": "release"}))
        for _ in range(3):
            header, payload = self.answer(stream)
            self.assertEqual((header["message"], len(payload)), ("grabbed", 3_600))
        self.assertEqual(self.answer(stream)[0]["message"], "error")
        # The main thread has seen none of it.
        self.assertTrue(self.server.events.empty())
        stream.close()
        self.wait_for(Note)
        self.assertTrue(self.screens[0].closed)

    def test_without_the_token_or_leave_nothing_is_shown(self):
        self.start()
        for token in ("", "open", None):
            self.assertIn(b"DTD_LINK_TOKEN", self.all_of(self.open(token)))
        self.start(grab=False)
        self.assertIn(b"grab = on", self.all_of(self.open()))
        self.assertEqual(self.screens, [])
        for token in (None, "", " "):
            with self.assertRaisesRegex(SettingsError, "grab = on"):
                Settings(grab=True, token=token)

    def test_a_screen_that_cannot_be_opened_says_why(self):
        self.start()
        with mock.patch.object(server.screen_grab, "open_screen", side_effect=server.ScreenError("the session is locked")):
            self.assertIn(b"the session is locked", self.all_of(self.open()))

    def test_some_may_watch_and_one_that_is_silent_gives_way(self):
        self.start()
        watching = [self.open() for _ in range(server.MAX_WATCHERS)]
        for stream in watching:
            self.answer(stream)
        self.assertIn(b"which is the most", self.all_of(self.open()))
        self.patch(SILENCE_S=1e-6)
        self.assertEqual(self.answer(self.open())[0]["message"], "screen_opened")

    def test_a_client_that_takes_no_picture_is_sent_no_further_one(self):
        self.start()
        stream = self.open()
        self.answer(stream)
        taken = threading.Semaphore(0)
        paper = self.screens[0]
        paper.size = lambda: (4_000, 4_000)
        paper.grab = lambda *part: taken.release() or bytes(48_000_000)
        stream.sendall(wire.pack({"message": "grab"}) * 20)
        self.assertTrue(taken.acquire(timeout=PATIENCE_S))
        # The first one does not fit into what both systems keep for us.
        self.assertFalse(taken.acquire(timeout=0.5))

    def test_only_a_client_on_another_computer_is_told_of_the_screen(self):
        for peer, here, elsewhere in (
            ("127.0.0.1", "127.0.0.1", False),
            ("127.0.0.1", "127.0.0.2", False),
            ("10.0.0.5", "10.0.0.5", False),
            ("10.0.0.5", "10.0.0.9", True),
            ("fe80::1%eth0", "fe80::1%eth0", False),
            ("fd00::5", "fd00::9", True),
        ):
            self.start()
            stream = self.greet({**HELLO, "token": "open sesame"})
            connection = self.wait_for(Opened).connection
            addresses = mock.Mock(getpeername=lambda: (peer, 40_000), getsockname=lambda: (here, 49_010))
            with mock.patch.object(connection, "_stream", addresses):
                self.assertEqual(self.server.screen_for(connection), {} if elsewhere else None, peer)
                self.server._grab = False
                refused = self.server.screen_for(connection)
                self.assertEqual(refused is not None and "grab = on" in refused["refused"], elsewhere)
            stream.close()


class Hostility(WithServer):
    def test_what_a_request_announces_is_not_read(self):
        asked = []

        def read(count):
            asked.append(count)
            return struct.pack("<II", 2, 190 << 20) if count == 8 else b"{}"

        with self.assertRaisesRegex(wire.WireError, "no payload"):
            wire.read_request(read)
        self.assertEqual(asked, [8])

    def test_without_the_token_nobody_is_let_in_and_nothing_is_asked(self):
        self.start(token="open sesame")
        for token in ("", "open", "\ud800", None, 7):
            received = self.all_of(self.greet({**HELLO, "token": token}))
            self.assertIn(b"DTD_LINK_TOKEN", received)
        self.greet({**HELLO, "token": "open sesame"})
        self.assertEqual(self.wait_for((Opened, Asked)).__class__, Opened)

    def test_nesting_that_python_cannot_follow_is_refused(self):
        self.start()
        text = b'{"message":"hello","x":' + b"[" * 60_000
        stream = self.connect()
        stream.sendall(wire.GREETING + struct.pack("<II", len(text), 0) + text)
        self.assertIn(b"not JSON", self.all_of(stream))

    def test_the_link_outlives_a_system_without_descriptors(self):
        self.patch(ACCEPT_PAUSE_S=0.01)
        self.start()
        accept, failures = self.server._listener.accept, 5

        class Short:
            def accept(_self):
                nonlocal failures
                if failures:
                    failures -= 1
                    raise OSError(errno.EMFILE, "Too many open files")
                return accept()

            def __getattr__(_self, name):
                return getattr(listener, name)

        listener = self.server._listener
        self.server._listener = Short()
        # The first one is still taken by the accept that waits already.
        for _ in range(2):
            self.greet().close()
            self.wait_for(Opened)
        self.assertEqual(failures, 0)

    def test_requests_beyond_the_agreed_number_wait(self):
        self.patch(MAX_OUTSTANDING=4)
        self.start()
        stream = self.greet()
        stream.sendall(wire.pack({"message": "release"}) * 50)
        for _ in range(4):
            connection = self.wait_for(Asked).connection
        self.assertTrue(self.server.events.empty())
        connection.answer({"message": "released"})
        self.wait_for(Asked)

    def test_an_empty_token_opens_nothing(self):
        for token in (None, "", "  "):
            with self.assertRaisesRegex(SettingsError, "token"):
                Settings(bind="0.0.0.0", token=token)
        Settings(bind="0.0.0.0", token="open sesame")

    def test_what_a_client_calls_itself_is_one_line_of_plain_characters(self):
        self.assertEqual(wire.printable("a\x1b[2J\nb\u202ec\u0085"), "a\\x1b[2J\\nb\\u202ec\\x85")


if __name__ == "__main__":
    unittest.main()
