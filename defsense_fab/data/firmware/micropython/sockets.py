"""UDP and TCP sockets that carry packets; nothing here waits."""

import errno

from frames import decode_cobs, encode_cobs
from links import OutputQueue
from packets import MAX_PACKET, PORT

_POLL_INTERVAL_US = 2000
_MAX_BATCH = 4  # packets that are read before sampling has a turn
_MAX_CONNECTIONS = 3
_QUEUE_SIZE = 2048
#: Largest number of bytes of a packet over TCP, with its zero byte.
_MAX_ENCODED = MAX_PACKET + MAX_PACKET // 254 + 2


class UdpPeer:
    """A host that is reached by datagrams.

    Args:
        socket: The board's socket.
        address: The host's address.
    """

    is_open = True

    def __init__(self, socket, address):
        self._socket, self._address = socket, address

    def has_room(self):
        """Return True: datagrams that cannot be sent are lost."""
        return True

    def send(self, packet):
        """Send a packet."""
        try:
            self._socket.sendto(packet, self._address)
        except OSError:  # no buffer is free, or the network is gone
            pass


class TcpPeer:
    """A host at the other end of a connection.

    Args:
        connection: Socket of the connection.

    Attributes:
        is_open: Whether the connection still exists.
    """

    def __init__(self, connection):
        self.is_open = True
        self.connection = connection
        self._queue = OutputQueue(self._write, _QUEUE_SIZE)
        self._encoded = bytearray(_MAX_ENCODED)
        self._received = b""

    def has_room(self):
        """Return whether a packet fits, and the connection exists."""
        return self._queue.count_room() >= _MAX_ENCODED

    def send(self, packet):
        """Send a packet."""
        self._queue.push(self._encoded, encode_cobs(packet, len(packet), self._encoded))
        self.drain()

    def drain(self):
        """Write what is waiting."""
        if self.is_open:
            self._queue.drain()

    def read_packets(self):
        """Return the packets that have arrived; anything else ends the connection."""
        try:
            data = self.connection.recv(_MAX_ENCODED)
        except OSError as error:
            self._note(error)
            return []
        parts = (self._received + data).split(b"\0")
        self._received = parts.pop()
        packets = [decode_cobs(part, len(part)) for part in parts if part]
        if not data or None in packets or len(self._received) >= _MAX_ENCODED:
            self.is_open = False
        return [packet for packet in packets if packet]

    def _write(self, data):
        try:
            return self.connection.send(data)
        except OSError as error:
            self._note(error)
            return 0

    def _note(self, error):
        if error.errno != errno.EAGAIN:  # nothing has arrived, or the buffer is full
            self.is_open = False


class Sockets:
    """The sockets of the board.

    Args:
        socket: The module `socket`.
        select: The module `select`.
        link: The `NetworkLink` that receives the packets.
        clock: The board's clock.
        host: Address to listen at.
        port: Port number; 0 for any free one.
    """

    def __init__(self, socket, select, link, clock, host="0.0.0.0", port=PORT):  # noqa: S104
        self._socket, self._link, self._clock = socket, link, clock
        self._poller, self._event = select.poll(), select.POLLIN
        self._peers = []
        self._polled_at = clock.ticks_us()
        address = socket.getaddrinfo(host, port)[0][-1]
        self._udp = self._bind(socket.SOCK_DGRAM, address)
        self._server = self._bind(socket.SOCK_STREAM, address)
        self._server.listen(_MAX_CONNECTIONS)

    def get_ports(self):
        """Return the port numbers of UDP and TCP (CPython only)."""
        return self._udp.getsockname()[1], self._server.getsockname()[1]

    def poll(self):
        """Hand packets that have arrived to the link, and write what is waiting."""
        now = self._clock.ticks_us()
        if self._clock.ticks_diff(now, self._polled_at) < _POLL_INTERVAL_US:
            return
        self._polled_at = now
        for peer in self._peers:
            peer.drain()
        for peer in [peer for peer in self._peers if not peer.is_open]:
            self._remove(peer)
        if not self._poller.poll(0):
            return
        self._read_datagrams()
        self._accept_connection()
        for peer in self._peers:
            for packet in peer.read_packets():
                self._link.receive(packet, peer)

    def close(self):
        """Close all sockets."""
        for peer in list(self._peers):
            self._remove(peer)
        for socket in (self._udp, self._server):
            self._poller.unregister(socket)
            socket.close()

    def _bind(self, kind, address):
        socket = self._socket.socket(self._socket.AF_INET, kind)
        socket.setsockopt(self._socket.SOL_SOCKET, self._socket.SO_REUSEADDR, 1)
        socket.bind(address)
        socket.setblocking(False)
        self._poller.register(socket, self._event)
        return socket

    def _read_datagrams(self):
        for _ in range(_MAX_BATCH):
            try:
                packet, address = self._udp.recvfrom(MAX_PACKET + 1)
            except OSError:  # there is no other one
                return
            self._link.receive(packet, UdpPeer(self._udp, address))

    def _accept_connection(self):
        """Accept a connection; if there are too many, close the oldest without a session."""
        try:
            connection, _ = self._server.accept()
        except OSError:  # there is none
            return
        connection.setblocking(False)
        if hasattr(self._socket, "TCP_NODELAY"):
            connection.setsockopt(self._socket.IPPROTO_TCP, self._socket.TCP_NODELAY, 1)
        if len(self._peers) == _MAX_CONNECTIONS:
            self._remove(next(peer for peer in self._peers if peer is not self._link.peer))
        self._peers.append(TcpPeer(connection))
        self._poller.register(connection, self._event)

    def _remove(self, peer):
        """Close a connection."""
        peer.is_open = False
        self._peers.remove(peer)
        self._poller.unregister(peer.connection)
        peer.connection.close()
