"""The images of a view."""

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self
from weakref import WeakSet, finalize

import av
import numpy as np
import numpy.typing as npt
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.reformatter import Colorspace, VideoReformatter

from dtd.files import CorpusError, damaged

Picture = npt.NDArray[np.uint8]

# FFmpeg recognises a file by its content, and would open the files that a playlist (DASH, HLS, concat) or a description (SDP) names.
_ONLY_THIS_FILE = {"format_whitelist": "mov,matroska,avi,mpegts", "protocol_whitelist": "file"}


class Video:
    """A view's video. Images are arrays of height x width x 3, RGB, 8 bits; image k belongs to tick k.

    Reading in order decodes each image once; a jump decodes from the key frame before it.
    """

    def __init__(
        self,
        path: Path,
        timestamps: npt.ArrayLike,
        unit_s: Fraction | None = None,
        size_px: tuple[int, int] | None = None,
        *,
        is_threaded: bool = True,
    ) -> None:
        """`timestamps`: the `pts` of every tick, in units of `unit_s` seconds; without it, in units of the file. `size_px`: width and height
        that the images must have. `is_threaded`: whether decoder and converter have threads, which read ahead."""
        self.path = path
        try:
            # Else the part of a relative path before a colon would be a protocol.
            self._container = av.open(f"file:{path}", container_options=_ONLY_THIS_FILE)
        except (av.ArgumentError, av.InvalidDataError) as error:
            why = "it is not an intact video file (MP4, Matroska, AVI or MPEG-TS; playlists are not followed)"
            raise damaged(path, why) from error
        except av.FFmpegError as error:
            raise damaged(path, error) from error
        # Containers and streams refer to each other: one that is only dropped keeps its threads until it is collected.
        self._process = os.getpid()
        self._close = finalize(self, _close, self._container, self._process)
        _videos.add(self)
        if not self._container.streams.video:
            raise damaged(path, "it has no video")
        self._stream = self._container.streams.video[0]
        found = (self._stream.width, self._stream.height)
        if size_px is not None and size_px != found:
            raise damaged(path, f"it has images of {found[0]} x {found[1]} px, the calibration {size_px[0]} x {size_px[1]} px")
        self._stream.thread_type = "AUTO" if is_threaded else "NONE"
        # The file may count in other units; the times are the same.
        ratio = Fraction(1) if unit_s is None else unit_s / Fraction(self._stream.time_base or unit_s)
        self._pts = np.asarray(timestamps, np.int64) * ratio.numerator
        if (self._pts % ratio.denominator).any():
            raise damaged(path, f"its unit of time, {self._stream.time_base} s, cannot express the times of the ticks, in {unit_s} s")
        self._pts //= ratio.denominator
        self._tick_of = {int(pts): tick for tick, pts in enumerate(self._pts)}
        self._reformatter = VideoReformatter()
        self._reformat_threads = 0 if is_threaded else 1
        self._decoder: Iterator[VideoFrame] | None = None
        self._next_tick = 0

    def __len__(self) -> int:
        """Number of images."""
        return len(self._pts)

    def __iter__(self) -> Iterator[Picture]:
        """All images, from the first."""
        for tick in range(len(self)):
            yield self[tick]

    def __getitem__(self, tick: int) -> Picture:
        """The image of a tick."""
        if not 0 <= tick < len(self):
            raise IndexError(f"{self.path} has the ticks 0 to {len(self) - 1}, not {tick}")
        if self._process != os.getpid():
            raise CorpusError(f"{self.path} was opened before this process was forked; its decoder works only in the parent: open it again here")
        if not self._close.alive:
            raise CorpusError(f"{self.path} is closed")
        try:
            with _named(self.path):
                return self._decoded(tick)
        except Exception:
            # A decoder that failed has no more images.
            self._decoder = None
            raise

    def _decoded(self, tick: int) -> Picture:
        wanted = int(self._pts[tick])
        if self._decoder is None or tick < self._next_tick or self._is_far(tick):
            self._container.seek(wanted, stream=self._stream, backward=True, any_frame=False)
            self._decoder = self._container.decode(self._stream)
        for frame in self._decoder:
            if frame.is_corrupt:
                raise damaged(self.path, f"its image with timestamp {frame.pts} is corrupt")
            at = self._tick_of.get(frame.pts) if frame.pts is not None else None
            if at is None:
                raise CorpusError(f"{self.path} has an image with timestamp {frame.pts}, which belongs to no tick")
            self._next_tick = at + 1
            if at == tick:
                return self._rgb(frame)
            if at > tick:
                break
        raise CorpusError(f"{self.path} has no image of tick {tick} (timestamp {wanted})")

    def _is_far(self, tick: int) -> bool:
        """Whether a key frame lies between the last image and this one, as far as the container knows."""
        first, last = int(self._pts[self._next_tick]), int(self._pts[tick])
        if last - first <= 0:
            return False
        index = self._stream.index_entries
        entry = index.search_timestamp(last, backward=True, any_frame=False)
        return entry >= 0 and index[entry].timestamp > first

    def _rgb(self, frame: VideoFrame) -> Picture:
        # Videos of this project are BT.709 and say so; FFmpeg's converter has to be told.
        source = Colorspace.ITU601 if frame.colorspace in (5, 6) else Colorspace.ITU709
        converted = self._reformatter.reformat(frame, format="rgb24", src_colorspace=source, threads=self._reformat_threads)
        return np.asarray(converted.to_ndarray(), np.uint8)

    def close(self) -> None:
        """Closes the file; one that was opened before this process was forked stays with the process that opened it."""
        if self._process == os.getpid() and self._close.alive:
            self._close()
            self._decoder = None
            del self._stream, self._reformatter, self._container

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def _close(container: InputContainer, process: int) -> None:
    if process == os.getpid():
        container.close()


_videos: WeakSet[Video] = WeakSet()
_at_fork: list[Video] = []


def _keep_forever() -> None:
    """Decoders and converters have threads, which do not survive a fork: freeing one in the forked process would wait for them forever, or
    crash. Garbage collection and the end of the interpreter free objects, so each video gets an extra reference that is never released."""
    for video in _at_fork:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(video))
    _at_fork.clear()


if hasattr(os, "register_at_fork"):
    # Held while the process is forked, so that no other hook has them collected.
    os.register_at_fork(
        before=lambda: _at_fork.extend(_videos),
        after_in_parent=_at_fork.clear,
        after_in_child=_keep_forever,
    )


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Errors of the decoder do not say which file."""
    try:
        yield
    except av.FFmpegError as error:
        raise damaged(path, error) from error
