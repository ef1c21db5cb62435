"""The sockets of the capture link, in separate threads. Nothing here calls ``xp``: X-Plane is not thread-safe.

XPPython3 keeps Python's interpreter lock between two callbacks, so these threads run only while a callback waits for them. The main
thread does that when there is something for them to do (:meth:`LinkServer.give_time`, :meth:`Connection.hand_over`); otherwise each step
of theirs, of which a request takes several, would cost a frame.

A connection for the screen (:class:`Watchers`) takes no seat and is served by its own thread; the main thread never sees it.

What the main thread sees: a queue of events (:class:`Opened`, :class:`Asked`, :class:`Closed`, :class:`Note`), and a
:class:`Connection` to answer on. One client at a time, see :class:`Seat`; it must send a hello, with the token if there is one,
before it is admitted.
"""

from __future__ import annotations

import hmac
import ipaddress
import queue
import select
import socket
import threading
import time
from dataclasses import dataclass

from . import screen_grab
from .screen_grab import ScreenError
from .settings import Settings
from .wire import GREETING, Header, WireError, WrongToken, check_greeting, pack, read_request

# From the connection to its greeting and its complete hello.
HELLO_TIMEOUT_S = 5.0
# How long a client waits for another one's seat.
SEAT_TIMEOUT_S = 2.0
# A client that neither sends requests nor reads answers for this long loses its seat to the next one.
SILENCE_S = 120.0
# Maximum connections, most of which wait to say hello or for the seat.
MAX_CONNECTIONS = 16
# Pending requests of a client, including those whose answer is not read yet. A client may send 64 captures ahead.
MAX_OUTSTANDING = 128
# Unread answers, bytes. Beyond that no request is started: unread pictures would fill X-Plane's memory.
MAX_QUEUED_BYTES = 64 << 20
# Maximum connections for the screen. A client needs one, and another one while it looks for the window.
MAX_WATCHERS = 4
# How long a frame of X-Plane waits for these threads at most, while there is something for them to do.
GIVE_TIME_S = 0.004
# Interval of looking whether there still is.
LOOK_AGAIN_S = 0.0002
# Delay after a client could not be accepted: others must first release the scarce resource, descriptors or threads.
ACCEPT_PAUSE_S = 0.1


class Connection:
    """One client. ``answer`` may be called from any thread; a separate thread writes."""

    def __init__(self, stream: socket.socket) -> None:
        self._stream = stream
        # Its computer, for the log; empty if it is gone already.
        self.source = _source(stream)
        self._outbox: queue.Queue[bytes | None] = queue.Queue()
        self._room = threading.Semaphore(MAX_OUTSTANDING)
        self._closed = threading.Event()
        # Set while no answer waits for the writer.
        self._handed_over = threading.Event()
        # Deadline for reading everything.
        self._deadline: float | None = time.monotonic() + HELLO_TIMEOUT_S
        self._lock = threading.Lock()
        self._unanswered = 0
        self._queued_bytes = 0
        self._last_heard = time.monotonic()
        self._writer = threading.Thread(target=self._write, name="dtd link writer", daemon=True)
        self._writer.start()

    def answer(self, header: Header, payload: bytes = b"") -> None:
        """Queues one answer. What cannot be sent any more is lost with its client."""
        message = pack(header, payload)
        with self._lock:
            self._queued_bytes += len(message)
        self._handed_over.clear()
        self._outbox.put(message)
        self._heard(-1)

    def hand_over(self) -> None:
        """Waits until the writer has begun to send the last answer, which it does without the interpreter lock."""
        self._handed_over.wait(GIVE_TIME_S)

    def is_unanswered(self) -> bool:
        """Whether a request of it is being processed."""
        with self._lock:
            return self._unanswered > 0

    def has_request(self) -> bool:
        """Whether bytes have come that its reader has not read, though it may."""
        if self._closed.is_set() or not self.takes_more():
            return False
        try:
            return bool(select.select([self._stream], [], [], 0)[0])
        except (OSError, ValueError):
            # Closed in between, or more descriptors than select takes.
            return False

    def takes_more(self) -> bool:
        """Whether the client has read enough of its answers for the next request to be started."""
        with self._lock:
            return self._queued_bytes < MAX_QUEUED_BYTES

    def greet(self) -> None:
        """Exchanges greetings."""
        self._stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._stream.settimeout(HELLO_TIMEOUT_S)
        self._stream.sendall(GREETING)
        check_greeting(self.read_exactly(8))

    def admitted(self, one_by_one: bool = False) -> None:
        """From now on the client may take its time. `one_by_one`: the next request is read when the client has read the previous
        answer."""
        self._deadline = None
        self._stream.settimeout(None)
        if one_by_one:
            # The coming answer makes space for the next.
            self._room = threading.Semaphore(0)

    def comes_from_elsewhere(self) -> bool:
        """Whether the client is on another computer: its address differs from the local end of the connection."""
        try:
            client, here = (ipaddress.ip_address(name()[0].split("%")[0]) for name in (self._stream.getpeername, self._stream.getsockname))
        except OSError:
            # It is gone.
            return False
        return client != here and not client.is_loopback

    def next_request(self) -> Header:
        """Blocks for a request, and before that for space for its answer."""
        while not self._room.acquire(timeout=1.0):
            if self._closed.is_set():
                raise EOFError("the client takes no more answers")
        header = read_request(self.read_exactly)
        self._heard(+1)
        return header

    def read_exactly(self, count: int) -> bytes:
        """Blocks for this many bytes."""
        buffer = bytearray(count)
        view, got = memoryview(buffer), 0
        while got < count:
            if self._deadline is not None:
                # For all of it: a byte now and then does not extend the time.
                left = self._deadline - time.monotonic()
                if left <= 0:
                    raise TimeoutError(f"no hello within {HELLO_TIMEOUT_S} s")
                self._stream.settimeout(left)
            step = self._stream.recv_into(view[got:])
            if step == 0:
                raise EOFError("the client closed the connection")
            got += step
        return bytes(buffer)

    def silent_s(self) -> float:
        """For how long the client has been silent; 0 while it waits for us."""
        takes_more = self.takes_more()
        with self._lock:
            waits_for_us = self._unanswered > 0 and takes_more
            return 0.0 if waits_for_us else time.monotonic() - self._last_heard

    def finish(self) -> None:
        """Sends what is queued, then closes."""
        self._outbox.put(None)
        if self._writer is not threading.current_thread():
            self._writer.join(timeout=5.0)
        self.abort()

    def abort(self) -> None:
        """Closes at once; a blocked reader wakes up."""
        self._closed.set()
        try:
            self._stream.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self._stream.close()

    def _heard(self, unanswered: int = 0) -> None:
        with self._lock:
            self._unanswered = max(0, self._unanswered + unanswered)
            self._last_heard = time.monotonic()

    def _write(self) -> None:
        while (message := self._outbox.get()) is not None:
            if self._outbox.empty():
                self._handed_over.set()
            try:
                self._stream.sendall(message)
            except OSError:
                self._closed.set()
                return
            with self._lock:
                self._queued_bytes -= len(message)
            self._heard()
            self._room.release()


def _source(stream: socket.socket) -> str:
    try:
        return str(stream.getpeername()[0])
    except OSError:
        return ""


class Seat:
    """The single place at the aircraft. A client keeps it as long as it uses it; a silent client keeps it until another one wants
    it.

    So a client may take all the time it needs between two requests, and one that hangs blocks nobody.
    """

    def __init__(self) -> None:
        self._place = threading.Lock()
        self._holder: Connection | None = None

    def take(self, connection: Connection) -> bool:
        """Whether the place became free in time."""
        holder = self._holder
        if holder is not None and holder.silent_s() >= SILENCE_S:
            holder.abort()
        if not self._place.acquire(timeout=SEAT_TIMEOUT_S):
            return False
        self._holder = connection
        return True

    def leave(self) -> None:
        """Releases the place."""
        self._holder = None
        self._place.release()


class Watchers:
    """The connections for the screen. One that has been silent for long gives way to a new one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._there: set[Connection] = set()

    def enter(self, connection: Connection) -> bool:
        """Whether there is space."""
        with self._lock:
            if len(self._there) >= MAX_WATCHERS:
                longest = max(self._there, key=Connection.silent_s)
                if longest.silent_s() < SILENCE_S:
                    return False
                longest.abort()
                self._there.remove(longest)
            self._there.add(connection)
            return True

    def are_busy(self) -> bool:
        """Whether an image is being grabbed."""
        with self._lock:
            return any(connection.is_unanswered() for connection in self._there)

    def leave(self, connection: Connection) -> None:
        """Releases the space."""
        with self._lock:
            self._there.discard(connection)


@dataclass(frozen=True)
class Opened:
    """A client said hello."""

    connection: Connection


@dataclass(frozen=True)
class Asked:
    """A client asks."""

    connection: Connection
    header: Header


@dataclass(frozen=True)
class Closed:
    """A client is gone."""

    connection: Connection


@dataclass(frozen=True)
class Note:
    """A line for X-Plane's log about a client, or about the listener itself."""

    text: str
    source: str = ""


Event = Opened | Asked | Closed | Note


class LinkServer:
    """Listens until closed."""

    def __init__(self, settings: Settings) -> None:
        self.events: queue.Queue[Event] = queue.Queue()
        self._token = (settings.token or "").strip() or None
        self._seat = Seat()
        self._grab = settings.grab
        self._watchers = Watchers()
        self._room = threading.Semaphore(MAX_CONNECTIONS)
        self._closing = threading.Event()
        self._open: set[Connection] = set()
        family = socket.AF_INET6 if ":" in settings.bind else socket.AF_INET
        self._listener = socket.create_server((settings.bind, settings.port), family=family)
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, name="dtd link", daemon=True).start()

    def screen_for(self, connection: Connection) -> Header | None:
        """What a client is told about this computer's screen: nothing if it can grab it itself, else `refused` has the reason."""
        if not connection.comes_from_elsewhere():
            return None
        reason = self._no_screen()
        return {} if reason is None else {"refused": reason}

    def _no_screen(self) -> str | None:
        """Why the screen is not provided, if it is not."""
        if not self._grab:
            return (
                "its plugin may not show this computer's screen: put `grab = on` below the token in [link] of dtd_bridge.ini, and restart X-Plane"
            )
        return screen_grab.no_way_here()

    def give_time(self) -> None:
        """Lets the threads run, from the main thread: as long as a request waits to be read, and briefly while a screen is grabbed."""
        deadline = time.monotonic() + GIVE_TIME_S
        while self._is_busy():
            time.sleep(LOOK_AGAIN_S)
            if time.monotonic() > deadline:
                return

    def _is_busy(self) -> bool:
        return self._watchers.are_busy() or any(connection.has_request() for connection in list(self._open))

    def close(self) -> None:
        """Stops listening and closes all connections."""
        self._closing.set()
        # On some systems only a shutdown wakes a thread that accepts.
        try:
            self._listener.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self._listener.close()
        for connection in list(self._open):
            connection.abort()

    def _accept(self) -> None:
        """Accepts clients as long as there is space; the others wait in the system's queue. No problem with one of them ends it."""
        failed_before = False
        while not self._closing.is_set():
            self._room.acquire()
            stream: socket.socket | None = None
            try:
                stream, _ = self._listener.accept()
                threading.Thread(target=self._serve, args=(stream,), name="dtd link reader", daemon=True).start()
                failed_before = False
            except (OSError, RuntimeError) as error:
                # No descriptor left, or no thread.
                if stream is not None:
                    stream.close()
                self._room.release()
                if not failed_before and not self._closing.is_set():
                    self.events.put(Note(f"the capture link can take no client now, and tries on: {error}"))
                failed_before = True
                self._closing.wait(ACCEPT_PAUSE_S)

    def _serve(self, stream: socket.socket) -> None:
        try:
            self._serve_in_room(stream)
        finally:
            self._room.release()

    def _serve_in_room(self, stream: socket.socket) -> None:
        connection = Connection(stream)
        self._open.add(connection)
        try:
            connection.greet()
            hello = self._admit(connection)
            if hello["message"] == "open_screen":
                self._show_screen(connection)
                return
            connection.admitted()
            if not self._seat.take(connection):
                connection.answer({"message": "error", "text": "another client holds the capture link"})
                return
            try:
                self._converse(connection, hello)
            finally:
                self.events.put(Closed(connection))
                self._seat.leave()
        except (OSError, EOFError) as error:
            self.events.put(Note(f"capture link closed: {error}", connection.source))
        except WireError as error:
            self.events.put(Note(f"capture link closed: {error}", connection.source))
            repeats = {"repeats": True} if error.repeats else {}
            connection.answer({"message": "error", "text": str(error), **repeats})
        finally:
            connection.finish()
            self._open.discard(connection)

    def _admit(self, connection: Connection) -> Header:
        """The first message of a client that may be admitted."""
        header = connection.next_request()
        if header["message"] not in ("hello", "open_screen"):
            raise WireError(f"the first message is {header['message'][:80]!r}, expected hello or open_screen")
        if self._token is not None:
            given = header.get("token")
            # JSON may contain lone surrogates, which cannot be encoded in UTF-8.
            if not isinstance(given, str) or not hmac.compare_digest(
                given.strip().encode("utf-8", "surrogatepass"), self._token.encode()
            ):
                raise WrongToken(
                    "this capture link is open to other machines and requires a token: set DTD_LINK_TOKEN to "
                    "the token of dtd_bridge.ini"
                )
        return header

    def _show_screen(self, connection: Connection) -> None:
        """Serves a connection for the screen, in its own thread."""
        reason = self._no_screen()
        if reason is not None:
            raise WireError(reason)
        if not self._watchers.enter(connection):
            raise WireError(f"{MAX_WATCHERS} connections watch the screen already, which is the most")
        try:
            connection.admitted(one_by_one=True)
            screen = screen_grab.open_screen()
            try:
                width, height = screen.size()
                connection.answer({"message": "screen_opened", "width_px": width, "height_px": height})
                while True:
                    connection.answer(*screen_grab.answer(screen, connection.next_request()))
            finally:
                screen.close()
        except ScreenError as error:
            raise WireError(str(error)) from error
        finally:
            self._watchers.leave(connection)

    def _converse(self, connection: Connection, hello: Header) -> None:
        self.events.put(Opened(connection))
        header = hello
        while True:
            self.events.put(Asked(connection, header))
            header = connection.next_request()
