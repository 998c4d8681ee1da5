"""Makes geomphys_pb2.py and geomphys_pb2.pyi from geomphys.proto: ``python -m geomphys.output.proto.generate [--check]``.

Needs grpcio-tools (extra ``test``); a user of the package does not. The compiler finds Foxglove's messages in the
descriptors of the installed foxglove-schemas-protobuf. What it writes is changed in two places: Foxglove's module is
imported from that package, and the check for one release of the protobuf runtime is left out, as the module holds
nothing but a descriptor, which any release reads.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
SOURCE = "geomphys.proto"
OUTPUTS = ("geomphys_pb2.py", "geomphys_pb2.pyi")
_RELEASE_CHECK = re.compile(
    r"^# Protobuf Python Version:.*\n|^from google\.protobuf import runtime_version .*\n|"
    r"^_runtime_version\.ValidateProtobufRuntimeVersion\((.|\n)*?^\)\n",
    re.MULTILINE,
)


def generate() -> dict[str, str]:
    """File name -> text of the generated modules; raises RuntimeError if the compiler refuses the source."""
    from foxglove_schemas_protobuf import Vector3_pb2
    from google.protobuf import timestamp_pb2
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from grpc_tools import protoc

    known = FileDescriptorSet()
    for module in (timestamp_pb2, Vector3_pb2):
        module.DESCRIPTOR.CopyToProto(known.file.add())
    with tempfile.TemporaryDirectory() as folder:
        descriptors = Path(folder, "known.bin")
        descriptors.write_bytes(known.SerializeToString())
        options = [f"--descriptor_set_in={descriptors}", f"--python_out={folder}", f"--pyi_out={folder}", f"-I{FOLDER}"]
        if protoc.main(["protoc", *options, SOURCE]) != 0:
            raise RuntimeError(f"protoc refused {FOLDER / SOURCE}: see its messages above")
        return {name: _adapted(Path(folder, name).read_text(encoding="utf-8")) for name in OUTPUTS}


def stale() -> list[str]:
    """Names of committed modules that differ from what the source gives."""
    fresh = generate()
    return [n for n in OUTPUTS if not (FOLDER / n).is_file() or (FOLDER / n).read_text(encoding="utf-8") != fresh[n]]


def _adapted(text: str) -> str:
    return _RELEASE_CHECK.sub("", text).replace("from foxglove import", "from foxglove_schemas_protobuf import")


def main(arguments: list[str]) -> int:
    """Write the modules, or with ``--check`` only say which are stale; the exit code."""
    if arguments == ["--check"]:
        names = stale()
        if names:
            sys.stderr.write(f"stale: {', '.join(names)}; run python -m geomphys.output.proto.generate\n")
        return 1 if names else 0
    for name, text in generate().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
