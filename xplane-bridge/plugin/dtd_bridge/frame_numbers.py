"""The number of a drawn frame, counted from X-Plane's callbacks. Pure.

X-Plane asks for the camera once a frame, before or after the flight loop of that frame, and draws 0 to n times a frame. Only a frame in
which all of this happened as expected has a number. Any doubt breaks the sequence: the next frame says that it does not know the ones
before it.
"""

from __future__ import annotations


class FrameNumbers:
    """One number for each frame that was drawn with our camera."""

    def __init__(self) -> None:
        self.number = 0
        # How many frames directly before this one have the numbers before it; -1: not even this one is known.
        self.steady = -1
        self._asked = False
        self._loop_since_asked = False
        self._loop_since_drawn = False

    def begin(self, at_least: int) -> None:
        """A new sequence, with numbers larger than all before."""
        self.number = max(self.number, at_least)
        self.steady = -1
        self._asked = self._loop_since_asked = self._loop_since_drawn = False

    def loop(self) -> None:
        """The flight loop ran."""
        self._loop_since_asked = self._loop_since_drawn = True

    def camera(self) -> bool:
        """X-Plane asks for the camera. Whether a new frame begins, which may show something else."""
        if self._asked:
            if self._loop_since_asked:
                # The last frame was not drawn, or X-Plane asks twice in this one.
                self._loop_since_asked = False
                self.number += 1
                self.steady = -1
            return False
        self._asked, self._loop_since_asked = True, False
        self.number += 1
        self.steady += 1
        return True

    def drawn(self) -> bool:
        """A frame is being drawn. Whether it has the current number."""
        if self._asked:
            self._asked = self._loop_since_drawn = False
        elif self._loop_since_drawn:
            # A frame for which X-Plane did not ask for the camera.
            self._loop_since_drawn = False
            self.steady = -1
        return self.steady >= 0

    def doubt(self) -> None:
        """This frame may show something else."""
        self.steady = -1
