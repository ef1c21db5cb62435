"""X-Plane's end of the capture link (docs/capture-link.md), as an XPPython3 plugin.

The modules:

``wire``           bytes <-> messages; ``messages``: headers <-> typed requests. Neither knows X-Plane.
``server``         sockets, in threads of their own. Nothing there calls ``xp``.
``bridge``         one step per simulator frame, in X-Plane's main thread: takes requests, runs them, sends answers.
``found``          X-Plane as the client found it, and giving it back.
``stage``          freezing, and the one callback that writes pose and camera of a tick; reads both back.
``capture``        settle frames, the frame that counts, its pixels and the proof that they are new.
``scenery``        waiting for the ground, and its height. ``traffic``: no other aircraft.
``flight``         air start, the crew's work, the log; ``approach``: what to dial when, pure. ``autopilot``: its switches, read and set.
``profile``        what ``dtd doctor`` measured, kept beside the plugin.
``local_frame``    WGS-84 poses <-> X-Plane's local OpenGL coordinates. Pure, given the two conversions of ``xp``.
``opengl``         the few OpenGL calls; ``check_pattern``: the image that proves a screen grab.
``xp_api``         the types of the functions of ``xp`` that are used here; ``mypy --strict`` holds the rest against them.
``screen_grab``    the screen of this computer, for a client on another one; ``screen_gdi``: of Windows, ``screen_x11``: of Linux. No ``xp``.
``datarefs``       typed access by name, and all names. ``settings``: the file beside the plugin.
"""

NAME = "dtd_bridge"
VERSION = "0.1.0"
