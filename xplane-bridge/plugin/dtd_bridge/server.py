"""The sockets of the capture link, in threads of their own. Nothing here calls ``xp``: X-Plane is not thread-safe.

What the main thread sees: a queue of events (:class:`Opened`, :class:`Asked`, :class:`Closed`, :class:`Note`), and a
:class:`Connection` to answer on. One client at a time: there is one aircraft.
"""

from __future__ import annotations

import hmac
import queue
import socket
import threading
from dataclasses import dataclass

from .settings import Settings
from .wire import GREETING, Header, WireError, check_greeting, pack, read_message

SEAT_TIMEOUT_S = 2.0
GREETING_TIMEOUT_S = 5.0


class Connection:
    """One client. ``answer`` may be called from any thread; a thread of its own writes."""

    def __init__(self, stream: socket.socket) -> None:
        self._stream = stream
        self._outbox: queue.Queue[bytes | None] = queue.Queue()
        self._writer = threading.Thread(target=self._write, name="dtd link writer", daemon=True)
        self._writer.start()

    def answer(self, header: Header, payload: bytes = b"") -> None:
        """Queues one answer. What cannot be sent any more is lost with its client."""
        self._outbox.put(pack(header, payload))

    def read_exactly(self, count: int) -> bytes:
        """Blocks for so many bytes."""
        buffer = bytearray(count)
        view, got = memoryview(buffer), 0
        while got < count:
            step = self._stream.recv_into(view[got:])
            if step == 0:
                raise EOFError("the client closed the connection")
            got += step
        return bytes(buffer)

    def finish(self) -> None:
        """Sends what is queued, then closes."""
        self._outbox.put(None)
        if self._writer is not threading.current_thread():
            self._writer.join(timeout=5.0)
        self.abort()

    def abort(self) -> None:
        """Closes at once; a blocked reader wakes up."""
        try:
            self._stream.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self._stream.close()

    def _write(self) -> None:
        while (message := self._outbox.get()) is not None:
            try:
                self._stream.sendall(message)
            except OSError:
                return


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
    """A line for X-Plane's log."""

    text: str


Event = Opened | Asked | Closed | Note


class LinkServer:
    """Listens until closed."""

    def __init__(self, settings: Settings) -> None:
        self.events: queue.Queue[Event] = queue.Queue()
        self._token = settings.token
        self._seat = threading.Lock()
        self._open: set[Connection] = set()
        family = socket.AF_INET6 if ":" in settings.bind else socket.AF_INET
        self._listener = socket.create_server((settings.bind, settings.port), family=family)
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, name="dtd link", daemon=True).start()

    def close(self) -> None:
        """Ends listening and all connections."""
        # On some systems only a shutdown wakes a thread that accepts.
        try:
            self._listener.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self._listener.close()
        for connection in list(self._open):
            connection.abort()

    def _accept(self) -> None:
        while True:
            try:
                stream, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(stream,), name="dtd link reader", daemon=True).start()

    def _serve(self, stream: socket.socket) -> None:
        connection = Connection(stream)
        self._open.add(connection)
        try:
            stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            stream.sendall(GREETING)
            stream.settimeout(GREETING_TIMEOUT_S)
            check_greeting(connection.read_exactly(8))
            stream.settimeout(None)
            if not self._seat.acquire(timeout=SEAT_TIMEOUT_S):
                connection.answer({"message": "error", "text": "another client holds the capture link"})
                return
            try:
                self._converse(connection)
            finally:
                self.events.put(Closed(connection))
                self._seat.release()
        except (OSError, EOFError) as error:
            self.events.put(Note(f"capture link closed: {error}"))
        except WireError as error:
            self.events.put(Note(f"capture link closed: {error}"))
            connection.answer({"message": "error", "text": str(error)})
        finally:
            connection.finish()
            self._open.discard(connection)

    def _converse(self, connection: Connection) -> None:
        header, _ = read_message(connection.read_exactly)
        if header["message"] != "hello":
            raise WireError(f"the first message is {header['message']}, expected hello")
        if self._token is not None:
            given = header.get("token")
            if not isinstance(given, str) or not hmac.compare_digest(given.encode(), self._token.encode()):
                raise WireError(
                    "this capture link is open to other machines and wants its token first: set DTD_LINK_TOKEN to "
                    "the token of dtd_bridge.ini"
                )
        self.events.put(Opened(connection))
        self.events.put(Asked(connection, header))
        while True:
            header, payload = read_message(connection.read_exactly)
            if payload:
                raise WireError(f"a request has no payload, but {len(payload)} bytes came")
            self.events.put(Asked(connection, header))
