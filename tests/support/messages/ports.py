"""Ports for tests of datagrams and connections."""

import socket


def free_port(host="127.0.0.1", kind=socket.SOCK_DGRAM):
    """Return an unused port."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, kind) as probe:
        probe.bind((host, 0))
        return probe.getsockname()[1]
