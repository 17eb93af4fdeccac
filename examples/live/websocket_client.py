"""Print the controls that are received over the WebSocket, without any library.

    defsense run my-device/model.json --port twin --output websocket   # in one terminal
    python websocket_client.py                                         # in another
    python websocket_client.py 192.168.1.20 8765 TOKEN                 # from another machine

The handshake and the frames follow RFC 6455, as far as needed here.
"""

import base64
import contextlib
import json
import os
import socket
import struct
import sys


def connect(host, port, token):
    """Return a connected stream after the handshake."""
    stream = socket.create_connection((host, port)).makefile("rwb")
    key = base64.b64encode(os.urandom(16)).decode()
    path = f"/?token={token}" if token else "/"
    stream.write(
        f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\n"
        f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
        "Sec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    stream.flush()
    status = stream.readline().decode()
    if " 101 " not in status:
        sys.exit(f"refused: {status.strip()}")
    while stream.readline().strip():
        pass  # headers
    return stream


def texts(stream):
    """Yield messages until the other side closes."""
    while True:
        head = stream.read(2)
        if len(head) < 2:
            return
        kind, size = head[0] & 15, head[1] & 127
        if size == 126:
            (size,) = struct.unpack(">H", stream.read(2))
        elif size == 127:
            (size,) = struct.unpack(">Q", stream.read(8))
        data = stream.read(size)
        if kind == 1:
            yield data.decode()
        elif kind == 9:  # a ping, which wants a pong: masked, as all that clients send
            stream.write(bytes([0x8A, 0x80 | len(data)]) + bytes(4) + data)
            stream.flush()
        elif kind == 8:
            return


def main():
    host = sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1"
    port = int(sys.argv[2]) if len(sys.argv) > 2 else 8765
    for text in texts(connect(host, port, sys.argv[3] if len(sys.argv) > 3 else "")):
        frame = json.loads(text)
        controls = "  ".join(f"{name} {value:+.2f}" for name, value in frame["controls"].items())
        print(f"{frame['time']:9.2f} s  {frame['quality']:9}  {controls}", flush=True)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
