"""Servers on 127.0.0.1 for the tests of URLs: a web server that gives ranges and counts bytes, and an S3 store."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote

import pytest


@dataclass
class Web:
    """A web server of a folder, and what it was asked for."""

    url: str
    sent: dict[str, int] = field(default_factory=dict)  # path -> bytes of content
    asked: list[str] = field(default_factory=list)  # paths, as they came
    longest: int = 0  # bytes of the longest answer
    ranges: bool = True  # whether parts are given
    says_ranges: bool | None = None  # whether it says so; None: as it is
    status: int = 200  # other: of every answer


@contextmanager
def web_server(folder: Path) -> Iterator[Web]:
    """Serve a folder's files, by range too."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *args: object) -> None:
            pass

        def do_HEAD(self) -> None:
            self.answer(False)

        def do_GET(self) -> None:
            self.answer(True)

        def answer(self, body: bool) -> None:
            web.asked.append(self.path)
            file = folder / unquote(self.path).lstrip("/")
            if not file.is_file() or web.status != 200:
                self.send_response(404 if web.status == 200 else web.status)
                self.send_header("Content-Length", "0")
                self.end_headers()
                return
            data = file.read_bytes()
            size = len(data)
            wanted = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
            if wanted and web.ranges:
                first, last = int(wanted[1]), min(int(wanted[2] or size - 1), size - 1)
                data = data[first : last + 1]
                self.send_response(206)
                self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
            else:
                self.send_response(200)
            if web.ranges if web.says_ranges is None else web.says_ranges:
                self.send_header("Accept-Ranges", "bytes")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            if body:
                web.sent[self.path] = web.sent.get(self.path, 0) + len(data)
                web.longest = max(web.longest, len(data))
                with suppress(ConnectionError):  # of a client that has seen enough
                    self.wfile.write(data)

    class Server(ThreadingHTTPServer):
        def handle_error(self, *args: object) -> None:
            if not isinstance(sys.exc_info()[1], ConnectionError):  # a client that has seen enough
                super().handle_error(*args)  # type: ignore[arg-type]

    server = Server(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    web = Web(f"http://127.0.0.1:{server.server_address[1]}")
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield web
    finally:
        server.shutdown()
        server.server_close()


@contextmanager
def s3_server(patch: pytest.MonkeyPatch) -> Iterator[str]:
    """An S3 store in a process of its own with one bucket; the environment names the store. Yields the bucket's URL.

    No two buckets have the same name: a batch locks its folder's URL for all processes of its user, other tests' too.
    """
    bucket = f"motion-{uuid.uuid4().hex}"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    script = f"from moto.server import main; main(['-H', '127.0.0.1', '-p', '{port}'])"
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    patch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    patch.setenv("AWS_ACCESS_KEY_ID", "nobody")
    patch.setenv("AWS_SECRET_ACCESS_KEY", "nothing")
    patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    try:
        until = time.monotonic() + 60.0
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
                break
            except OSError:
                assert process.poll() is None, "the S3 server ended"
                assert time.monotonic() < until, "the S3 server does not answer"
                time.sleep(0.1)
        import boto3

        client = boto3.client("s3")
        client.create_bucket(Bucket=bucket)
        client.close()
        import s3fs

        s3fs.S3FileSystem.clear_instance_cache()  # which would ask a server of an earlier test
        yield f"s3://{bucket}"
    finally:
        process.terminate()
        process.wait()
