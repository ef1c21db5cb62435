"""Serves videos as cameras over RTSP, and breaks them: all begin together with the first client, so that their wall clocks mean what the
images show.

    rtsp_server.py [--port PORT] [--user NAME:PASSWORD [--digest]] [--tls CERTIFICATE] [--absent NAME] NAME[:VARIANT]=VIDEO.mp4 ...

Packets are copied, not encoded. A client that comes later sees the stream from the next key frame on. A camera has one address and may have
variants (`left:small=..`), which run beside it; the first one is shown. The first line on stdout is the port, on the loopback device; `playing`
follows with the UTC time in seconds, and so does `switched`. Lines on stdin break a camera:

    drop NAME             its clients are disconnected, and its address is gone
    offer NAME [VARIANT]  it is there again, with this video
    switch NAME [VARIANT] another video of the same codec, in the same stream
    freeze NAME           its last key frame again and again, until its next one after `thaw NAME`
    lose NAME PART        so many of its packets are lost, 0 to 1
    count NAME RATE       its timestamps count so many images per second, however many it sends

Needs Debian's gir1.2-gst-rtsp-server-1.0, gstreamer1.0-plugins-good and python3-gi: run it with /usr/bin/python3.
"""

import argparse
import sys
import threading
import time

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstApp", "1.0")
gi.require_version("GstRtsp", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import Gio, GLib, Gst, GstApp, GstRtsp, GstRtspServer  # noqa: E402, F401

PAYLOADERS = {"video/x-h264": "rtph264pay config-interval=-1", "video/x-h265": "rtph265pay config-interval=-1", "image/jpeg": "rtpjpegpay"}


class Video:
    """A video that is played once, in its own time."""

    def __init__(self, path, shown):
        self.shown = shown
        self.player = Gst.parse_launch(
            f'filesrc location="{path}" ! qtdemux ! appsink name=sink sync=true emit-signals=true max-buffers=60'
        )
        sink = self.player.get_by_name("sink")
        sink.connect("new-sample", self.pass_on)
        # The caps are needed before the first client asks.
        self.player.set_state(Gst.State.PAUSED)
        self.caps = sink.emit("pull-preroll").get_caps()

    def pass_on(self, sink):
        sample = sink.emit("pull-sample")
        self.shown(self, sample.get_buffer().copy())
        return Gst.FlowReturn.OK


class Camera:
    """An address whose clients see one of its videos."""

    def __init__(self, name, server, role, configured):
        self.name, self.server, self.role, self.configured = name, server, role, configured
        self.videos, self.video, self.next = {}, None, None
        self.key = self.frozen = None
        self.source = self.loss = self.rate = None
        self.counted = 0
        self.clients = []

    def add(self, variant, path):
        self.videos[variant] = Video(path, self.show)
        self.video = self.video or self.videos[variant]

    def offer(self, variant=""):
        self.video, self.next = self.videos[variant], None
        payloader = PAYLOADERS[self.video.caps.get_structure(0).get_name()]
        factory = GstRtspServer.RTSPMediaFactory()
        factory.set_launch(
            f"( appsrc name=source is-live=true do-timestamp=true format=time block=false ! {payloader} pt=96 "
            "! identity name=pay0 drop-probability=0 )"
        )
        factory.set_shared(True)
        factory.connect("media-configure", self.configure)
        if self.role is not None:
            factory.add_role_from_structure(self.role)
        self.server.get_mount_points().add_factory(f"/{self.name}", factory)

    def drop(self):
        self.server.get_mount_points().remove_factory(f"/{self.name}")
        clients, self.clients = self.clients, []
        for client in clients:
            client.close()

    def switch(self, variant=""):
        """With its next key frame."""
        self.next = self.videos[variant]

    def freeze(self):
        self.frozen = self.key

    def thaw(self):
        self.key = None

    def lose(self, part):
        self.loss.set_property("drop-probability", float(part))

    def count(self, rate):
        self.rate = float(rate)

    def configure(self, _factory, media):
        element = media.get_element()
        self.source, self.loss = element.get_child_by_name("source"), element.get_child_by_name("pay0")
        self.source.set_property("caps", self.video.caps)
        media.connect("unprepared", self.forget, self.source)
        self.configured()

    def forget(self, _media, source):
        if self.source is source:
            self.source = None

    def show(self, video, buffer):
        if video is self.next and not buffer.has_flags(Gst.BufferFlags.DELTA_UNIT):
            self.video, self.next = video, None
            print("switched", time.time(), flush=True)
        if video is not self.video:
            return
        if not buffer.has_flags(Gst.BufferFlags.DELTA_UNIT):
            if self.frozen is not None and self.key is None:
                self.frozen = None
            self.key = buffer if self.frozen is None else self.key
        if self.frozen is not None:
            buffer = self.frozen.copy()
        source = self.source
        if source is not None:
            buffer.pts = buffer.dts = Gst.CLOCK_TIME_NONE
            if self.rate is not None:
                buffer.pts = round(self.counted / self.rate * Gst.SECOND)
                self.counted += 1
            if not source.get_property("caps").is_equal(video.caps):
                source.set_property("caps", video.caps)
            source.emit("push-buffer", buffer)


def guard(server, user, is_digest, certificate):
    """Asks for a password if there is a user, encrypts with a certificate, and returns the role of those who may see the cameras."""
    name, password = user.split(":", 1) if user else ("", "")
    auth = GstRtspServer.RTSPAuth()
    if certificate:
        auth.set_tls_certificate(Gio.TlsCertificate.new_from_file(certificate))
    token = GstRtspServer.RTSPToken()
    token.set_string(GstRtspServer.RTSP_TOKEN_MEDIA_FACTORY_ROLE, "viewer")
    if not user:
        auth.set_default_token(token)
    elif is_digest:
        auth.set_supported_methods(GstRtsp.RTSPAuthMethod.DIGEST)
        auth.add_digest(name, password, token)
    else:
        auth.add_basic(GstRtspServer.RTSPAuth.make_basic(name, password), token)
    server.set_auth(auth)
    role = Gst.Structure.new_empty("viewer")
    role.set_value(GstRtspServer.RTSP_PERM_MEDIA_FACTORY_ACCESS, True)
    role.set_value(GstRtspServer.RTSP_PERM_MEDIA_FACTORY_CONSTRUCT, True)
    return role


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", default="0")
    parser.add_argument("--user", metavar="NAME:PASSWORD")
    parser.add_argument("--digest", action="store_true", help="the password is asked for by digest instead of basic authentication")
    parser.add_argument("--tls", metavar="CERTIFICATE", help="connections are encrypted; the file (PEM) has the key as well")
    parser.add_argument("--absent", action="append", default=[], metavar="NAME", help="this camera is not there until it is offered")
    parser.add_argument("videos", nargs="+", metavar="NAME=VIDEO")
    args = parser.parse_args()
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(args.port)
    role = guard(server, args.user, args.digest, args.tls) if args.user or args.tls else None
    cameras, is_playing = {}, []

    def configured():
        if not is_playing:
            is_playing.append(True)
            for camera in cameras.values():
                for video in camera.videos.values():
                    video.player.set_state(Gst.State.PLAYING)
            print("playing", time.time(), flush=True)

    def connected(_server, client):
        client.connect("describe-request", described)

    def described(client, context):
        cameras[context.uri.abspath.strip("/")].clients.append(client)

    def obey(command):
        verb, name, *more = command.split()
        getattr(cameras[name], verb)(*more)

    def read_commands():
        for line in sys.stdin:
            GLib.idle_add(obey, line)

    for video in args.videos:
        names, path = video.split("=", 1)
        name, _, variant = names.partition(":")
        camera = cameras.setdefault(name, Camera(name, server, role, configured))
        camera.add(variant, path)
    for name, camera in cameras.items():
        if name not in args.absent:
            camera.offer()
    server.connect("client-connected", connected)
    threading.Thread(target=read_commands, daemon=True).start()
    server.attach(None)
    print(server.get_bound_port(), flush=True)
    GLib.MainLoop().run()


main()
