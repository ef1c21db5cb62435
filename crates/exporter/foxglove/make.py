"""Writes schemas.bin: Foxglove's published Protobuf schemas that the export to MCAP uses, as one FileDescriptorSet.

Usage: python make.py     with the package foxglove-schemas-protobuf (scripts/requirements.txt)
"""

from importlib import import_module
from pathlib import Path

from google.protobuf.descriptor_pb2 import FileDescriptorSet

NAMES = ["CameraCalibration", "CompressedVideo", "FrameTransforms", "ImageAnnotations", "LocationFix", "PoseInFrame"]

files = {}


def add(file):
    """A file after those that it imports."""
    for imported in file.dependencies:
        add(imported)
    files.setdefault(file.name, file)


for name in NAMES:
    add(import_module(f"foxglove_schemas_protobuf.{name}_pb2").DESCRIPTOR)
schemas = FileDescriptorSet()
for file in files.values():
    file.CopyToProto(schemas.file.add())
Path(__file__).with_name("schemas.bin").write_bytes(schemas.SerializeToString(deterministic=True))
