"""Commands in a network namespace of their own: ``unshare -n python watched_network.py FILE``, a JSON list of commands.

All that would leave the machine goes to a TUN device, which this script reads: every packet is seen, none is answered.
Prints a JSON line for each command: its exit code, what it said, and the packets since the last one (protocol, address, port,
text in it).
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
_SIOCSIFADDR, _SIOCSIFNETMASK, _SIOCGIFFLAGS, _SIOCSIFFLAGS, _SIOCADDRT = 0x8916, 0x891C, 0x8913, 0x8914, 0x890B
_UP, _RTF_UP, _RTF_GATEWAY = 0x1, 0x1, 0x2


def open_device() -> int:
    """Bring up the loopback and a TUN device that everything else is routed to; its descriptor."""
    tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH22x", b"tun0", _IFF_TUN | _IFF_NO_PI))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        for request, address in ((_SIOCSIFADDR, "10.99.0.1"), (_SIOCSIFNETMASK, "255.255.255.0")):
            fcntl.ioctl(control, request, struct.pack("16s", b"tun0") + _address(address) + bytes(8))
        for name in (b"lo", b"tun0"):
            flags = struct.unpack("16sH", fcntl.ioctl(control, _SIOCGIFFLAGS, struct.pack("16sH22x", name, 0))[:18])[1]
            fcntl.ioctl(control, _SIOCSIFFLAGS, struct.pack("16sH22x", name, flags | _UP))
        route = struct.pack("L", 0) + _address("0.0.0.0") + _address("10.99.0.2") + _address("0.0.0.0")
        fcntl.ioctl(control, _SIOCADDRT, route + struct.pack("H", _RTF_UP | _RTF_GATEWAY) + bytes(62))
    return tun


def _address(text: str) -> bytes:
    return struct.pack("HH4s8x", socket.AF_INET, 0, socket.inet_aton(text))


def packets(tun: int) -> list[str]:
    """What has come since the last look; not the kernel's own announcements of IPv6."""
    found = []
    while True:
        try:
            data = os.read(tun, 65536)
        except BlockingIOError:
            return found
        if data[0] >> 4 == 4:
            start = 4 * (data[0] & 15)
            port = struct.unpack(">H", data[start + 2 : start + 4])[0] if data[9] in (6, 17) else 0
            text = b" ".join(re.findall(rb"[\w-]{3,}", data[start + 8 :])).decode("ascii", "replace")
            found.append(f"protocol {data[9]} to {socket.inet_ntoa(data[16:20])}:{port} {text}")


def main() -> None:
    """Run each command and tell what it did; those that end by a time limit (``timeout``) meanwhile."""
    tun = open_device()
    started = [
        (words, subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE))
        for words in json.loads(Path(sys.argv[1]).read_text())
        if words[0] == "timeout"
    ]
    for words in json.loads(Path(sys.argv[1]).read_text()):
        if words[0] != "timeout":
            tell(tun, words, subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE))
    for words, child in started:
        tell(tun, words, child)


def tell(tun: int, words: list[str], child: subprocess.Popen[bytes]) -> None:
    """Wait for a command and print what it did, and the packets since the last one."""
    _, said = child.communicate(timeout=300)
    time.sleep(0.05)
    end = {"words": words, "code": child.returncode, "said": said.decode(errors="replace"), "packets": packets(tun)}
    sys.stdout.write(json.dumps(end) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
