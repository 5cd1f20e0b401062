"""New addresses on this machine for each transport."""

import os
import socket
import uuid


def new_addresses(scheme: str) -> tuple[str, str]:
    """Return addresses to read and to publish, for the scheme "mailbox", "shm", "udp" or "zenoh"."""
    name = f"bench-{os.getpid()}-{uuid.uuid4().hex[:8]}"
    if scheme in ("mailbox", "shm"):
        address = f"{scheme}:{name}" if scheme == "mailbox" else f"{scheme}://{name}"
        return address, address
    endpoint = f"127.0.0.1:{_free_port(socket.SOCK_DGRAM if scheme == 'udp' else socket.SOCK_STREAM)}"
    if scheme == "udp":
        return f"udp://{endpoint}", f"udp://{endpoint}"
    return f"zenoh://{name}?listen=tcp/{endpoint}", f"zenoh://{name}?connect=tcp/{endpoint}"


def _free_port(kind):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
