"""Addresses of transports, and the errors of invalid ones."""

import pytest

from proximity.errors import PublishError
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber
from proximity.transport.address import parse


@pytest.mark.parametrize(
    ("text", "scheme", "location", "options"),
    [
        ("shm://proximity/poses", "shm", "proximity/poses", {}),
        ("UDP://127.0.0.1:9100", "udp", "127.0.0.1:9100", {}),
        ("udp://[::1]:9100?from=[::1]:9101", "udp", "[::1]:9100", {"from": "[::1]:9101"}),
        ("udp://[fe80::1%25eth0]:9100", "udp", "[fe80::1%eth0]:9100", {}),
        ("udp://h:1?bind=0.0.0.0&x=", "udp", "h:1", {"bind": "0.0.0.0", "x": ""}),
        ("mailbox:a%20box", "mailbox", "a box", {}),
    ],
)
def test_address_is_taken_apart(text, scheme, location, options):
    address = parse(text)

    assert (address.text, address.scheme, address.location, address.options) == (
        text, scheme, location, options,
    )  # fmt: skip


@pytest.mark.parametrize("text", ["", "decaff", "mailbox:", "shm://a#b"])
def test_text_that_is_no_address_is_told_what_one_looks_like(text):
    with pytest.raises(PublishError, match=r": expected an address such as shm://NAME, udp://HOST:PORT, "):
        parse(text)


@pytest.mark.parametrize("text", ["udp://[::1:9100", "udp://h:1?a=1&b"])
def test_text_that_cannot_be_taken_apart_is_told_the_form(text):
    with pytest.raises(PublishError, match=r": expected scheme://location\?option=value \("):
        parse(text)


@pytest.mark.parametrize("value", [None])
def test_address_is_text(value):
    with pytest.raises(PublishError, match=r"^an address is text such as shm://proximity, not "):
        parse(value)


def test_option_given_twice_is_refused():
    with pytest.raises(PublishError, match=r"^udp://h:1\?from=a&from=b: an option is given twice"):
        parse("udp://h:1?from=a&from=b")


@pytest.mark.parametrize("opener", [open_outlet, open_inlet, open_publisher, open_subscriber])
def test_unknown_scheme_is_told_those_that_are_known(opener):
    with pytest.raises(
        PublishError,
        match=r"^tcp://a:1: no transport is called 'tcp' \(expected mailbox, shm, udp, ws, zenoh\)$",
    ):
        opener("tcp://a:1")


@pytest.mark.parametrize(
    ("text", "known", "message"),
    [
        ("mailbox:a?x=1", (), r"unknown option 'x' \(it has none\)$"),
        ("udp://h:1?x=1", ("bind", "from"), r"unknown option 'x' \(expected bind, from\)$"),
    ],
)
def test_unknown_option_is_told_those_that_are_known(text, known, message):
    with pytest.raises(PublishError, match=message):
        parse(text).check_options(*known)


def test_subscriber_that_cannot_be_made_gives_the_address_back():
    from ports import free_port

    from proximity.errors import ArgumentError

    address = f"udp://127.0.0.1:{free_port()}"
    with pytest.raises(
        ArgumentError, match=r"^stale_after is -1, expected a number of seconds of 0 or more$"
    ):
        open_subscriber(address, stale_after=-1)

    open_subscriber(address).close()


def test_files_of_an_address_are_named_as_seen_from_a_folder(tmp_path):
    folder = str(tmp_path / "a folder & more")
    text = "udp://[::1]:9100?from=[::1]:1&key=keys/my%20key"
    moved = parse(parse(text).with_files_in(folder))

    assert moved.location == "[::1]:9100"
    assert moved.options == {"from": "[::1]:1", "key": f"{folder}/keys/my key"}
    assert parse(moved.text).with_files_in("/elsewhere") == moved.text
    for without in (
        "shm://proximity",
        "zenoh://a?connect=tcp/h:1,tcp/h:2",
        "mailbox:a box",
        "udp://h:1?key=",
    ):
        assert parse(without).with_files_in(folder) == without
