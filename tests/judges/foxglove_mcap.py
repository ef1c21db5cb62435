"""An MCAP file as its own reader sees it, every checksum checked, with the messages decoded by Foxglove's published classes and the
images decoded from the messages alone.

Usage: python foxglove_mcap.py FILE.mcap VIDEOS    VIDEOS: folder of the videos that it was made from; prints JSON
"""

import hashlib
import json
import sys
from importlib import import_module
from pathlib import Path

import av
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.json_format import MessageToDict
from mcap.reader import make_reader



def published(name):
    return getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)


def pixels(frame):
    return hashlib.sha256(b"".join(bytes(plane) for plane in frame.planes)).hexdigest()


messages, videos, last_time = {}, {}, 0
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    summary = reader.get_summary()
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        assert message.log_time >= last_time, "the file goes back in time"
        last_time = message.log_time
        if channel.message_encoding == "json":
            content = {"time_ns": message.log_time} | json.loads(message.data)
            assert schema.encoding == "jsonschema" and json.loads(schema.data)["type"] == "object"
        else:
            package, name = schema.name.split(".")
            assert (package, schema.encoding, channel.message_encoding) == ("foxglove", "protobuf", "protobuf")
            kind = published(name)
            described = {file.name: file for file in FileDescriptorSet.FromString(schema.data).file}
            expected = type(described[kind.DESCRIPTOR.file.name])()
            kind.DESCRIPTOR.file.CopyToProto(expected)
            assert described[kind.DESCRIPTOR.file.name] == expected, f"{schema.name} is not what Foxglove publishes"
            decoded = kind.FromString(message.data)
            content = MessageToDict(decoded, preserving_proto_field_name=True)
            if name == "CompressedVideo":
                videos.setdefault(channel.topic, (decoded.format, []))[1].append(decoded.data)
                del content["data"]
        messages.setdefault(channel.topic, []).append(content)
assert summary.statistics.message_count == sum(len(found) for found in messages.values())

equal = {}
for topic, (form, packets) in videos.items():
    decoder = av.CodecContext.create(form, "r")
    found = [pixels(frame) for data in packets for frame in decoder.decode(av.Packet(data))]
    found += [pixels(frame) for frame in decoder.decode(None)]
    with av.open(next(Path(sys.argv[2]).glob(topic.split("/")[1] + ".*"))) as video:
        recorded = [pixels(frame) for frame in video.decode(video=0)]
    assert found == recorded, f"{topic}: {len(found)} images, recorded {len(recorded)}"
    equal[topic] = len(found)
print(json.dumps({"messages": messages, "pictures": equal}))
