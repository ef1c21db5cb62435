"""Serves videos as cameras over RTSP: all begin together with the first client, so that their wall clocks mean what the images show.

    rtsp_server.py [--port PORT] [--user NAME:PASSWORD] NAME=VIDEO.mp4 ...

Packets are copied, not encoded. A client that comes later sees the stream from the next key frame on. The first line on stdout is the port,
on the loopback device. Needs Debian's gir1.2-gst-rtsp-server-1.0, gstreamer1.0-plugins-good and python3-gi: run it with /usr/bin/python3.
"""

import argparse

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstApp", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstApp, GstRtspServer  # noqa: E402, F401


class Camera:
    """A video that is played once, in its own time, to whoever is connected."""

    def __init__(self, name, path, mounts, configured):
        self.source = None
        self.caps = None
        self.player = Gst.parse_launch(
            f'filesrc location="{path}" ! qtdemux ! appsink name=sink sync=true emit-signals=true max-buffers=60'
        )
        self.player.get_by_name("sink").connect("new-sample", self.pass_on)
        factory = GstRtspServer.RTSPMediaFactory()
        factory.set_launch(
            "( appsrc name=source is-live=true do-timestamp=true format=time block=false "
            "! rtph264pay name=pay0 pt=96 config-interval=-1 )"
        )
        factory.set_shared(True)
        factory.connect("media-configure", self.configure, configured)
        mounts.add_factory(f"/{name}", factory)
        # The caps are needed before the first client asks.
        self.player.set_state(Gst.State.PAUSED)
        sample = self.player.get_by_name("sink").emit("pull-preroll")
        self.caps = sample.get_caps()

    def configure(self, _factory, media, configured):
        self.source = media.get_element().get_child_by_name("source")
        self.source.set_property("caps", self.caps)
        media.connect("unprepared", self.forget, self.source)
        configured()

    def forget(self, _media, source):
        if self.source is source:
            self.source = None

    def pass_on(self, sink):
        sample = sink.emit("pull-sample")
        source = self.source
        if source is not None:
            buffer = sample.get_buffer().copy()
            buffer.pts = buffer.dts = Gst.CLOCK_TIME_NONE
            source.emit("push-buffer", buffer)
        return Gst.FlowReturn.OK


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", default="0")
    parser.add_argument("--user")
    parser.add_argument("videos", nargs="+", metavar="NAME=VIDEO")
    args = parser.parse_args()
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(args.port)

    def configured():
        for camera in cameras:
            camera.player.set_state(Gst.State.PLAYING)

    cameras = []
    for video in args.videos:
        name, path = video.split("=", 1)
        cameras.append(Camera(name, path, server.get_mount_points(), configured))
    if args.user:
        name, password = args.user.split(":", 1)
        auth = GstRtspServer.RTSPAuth()
        token = GstRtspServer.RTSPToken()
        token.set_string(GstRtspServer.RTSP_TOKEN_MEDIA_FACTORY_ROLE, "viewer")
        auth.add_basic(GstRtspServer.RTSPAuth.make_basic(name, password), token)
        server.set_auth(auth)
        role = {GstRtspServer.RTSP_PERM_MEDIA_FACTORY_ACCESS: True, GstRtspServer.RTSP_PERM_MEDIA_FACTORY_CONSTRUCT: True}
        for camera in args.videos:
            factory = server.get_mount_points().match("/" + camera.split("=", 1)[0])[0]
            structure = Gst.Structure.new_empty("viewer")
            for permission, value in role.items():
                structure.set_value(permission, value)
            factory.add_role_from_structure(structure)
    server.attach(None)
    print(server.get_bound_port(), flush=True)
    GLib.MainLoop().run()


main()
