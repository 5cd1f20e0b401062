"""Zenoh over loopback, between endpoints that are named: no test depends on multicast."""

import os
import shutil
import socket
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from far_end import PATIENCE, FarEnd, frame, touch, until, until_valid
from pages import PAGES

from proximity.errors import PublishError
from proximity.message import State
from proximity.transport import open_inlet, open_outlet, open_publisher, open_subscriber
from proximity.transport.link import NOTHING

pytest.importorskip("zenoh", reason="eclipse-zenoh, of the extra zenoh, is not installed")


@pytest.fixture
def ends():
    """The two addresses of one key: where the publisher listens, where the subscriber connects to."""
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    key = f"zenoh://test/{os.getpid()}"
    return f"{key}?listen={endpoint}", f"{key}?connect={endpoint}"


@pytest.fixture
def linked(ends):
    """Two open ends that have found each other, and nothing waits."""
    outlet, inlet, room = open_outlet(ends[0]), open_inlet(ends[1]), np.zeros(9, np.uint8)

    def has_arrived():
        outlet.send(np.zeros(9, np.uint8))
        return inlet.wait(0.05)

    until(has_arrived)
    while inlet.wait(0.2):
        inlet.receive(room)
    yield outlet, inlet
    outlet.close()
    inlet.close()


def test_messages_arrive_in_order(linked):
    outlet, inlet = linked
    room, numbers = np.zeros(100, np.uint8), []
    for number in range(50):
        outlet.send(np.full(100, number, np.uint8))
        assert inlet.wait(PATIENCE)
        assert inlet.receive(room) == 100
        numbers.append(int(room[99]))

    assert numbers == list(range(50))
    assert inlet.receive(room) == NOTHING


def test_session_that_has_ended_is_a_sentence(linked):
    _, inlet = linked
    inlet._session.close()

    for receive in (lambda: inlet.receive(np.zeros(9, np.uint8)), lambda: inlet.wait(0.0)):
        with pytest.raises(PublishError, match=r"^zenoh://test/.*: cannot receive \("):
            receive()


def test_slow_subscriber_keeps_the_latest(linked):
    outlet, inlet = linked
    room = np.zeros(1, np.uint8)
    for number in range(200):
        outlet.send(np.full(1, number, np.uint8))
        time.sleep(0.001)
    time.sleep(0.2)
    numbers = []
    while inlet.receive(room) != NOTHING:
        numbers.append(int(room[0]))

    assert len(numbers) <= 66  # a message that was looked at, the ring, and one on its way
    assert numbers == sorted(numbers)
    assert numbers[-1] == 199


def test_whole_skin_arrives_and_of_too_long_a_message_the_beginning(linked):
    outlet, inlet = linked
    message = np.arange(96 + 4096 * 328, dtype=np.uint32).astype(np.uint8)
    room = np.zeros(len(message), np.uint8)

    def has_arrived():  # on a loaded machine, it may be dropped
        outlet.send(message)
        return inlet.wait(0.5)

    until(has_arrived)
    assert inlet.receive(room) == len(message)
    assert np.array_equal(room, message)
    room[:] = 0
    until(has_arrived)
    assert inlet.receive(room[:10]) == len(message)
    assert room[:11].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 0]


def test_frames_of_another_process_are_aged_by_its_own_clock(ends):
    with open_subscriber(ends[1]) as subscriber, FarEnd("publish", ends[0], 3):
        until_valid(subscriber)
        assert len(subscriber.wait(PATIENCE).contacts) == 3
        assert not subscriber.counts.flawed


def test_subscriber_ages_when_the_publisher_is_killed_and_takes_to_the_next(ends):
    with open_subscriber(ends[1], stale_after=0.5) as subscriber:
        with FarEnd("publish", ends[0]) as first:
            until_valid(subscriber)
            first.kill()
        states = set()

        def is_stale():
            states.add(subscriber.read().state)
            return State.STALE in states

        until(is_stale)
        assert State.LATE in states
        with FarEnd("publish", ends[0]):
            until_valid(subscriber)
        assert subscriber.counts.sessions == 2


def test_killed_subscriber_does_not_keep_the_publisher(ends):
    with open_publisher(ends[0]) as publisher:
        for _ in range(2):
            with FarEnd("subscribe", ends[1]) as reader:
                assert reader.said == "ready"
                for _ in range(50):
                    publisher.publish(touch(frame()))
                reader.kill()
                for _ in range(50):
                    publisher.publish(touch(frame()))


def test_nobody_there_is_no_error(ends):
    room = np.zeros(9, np.uint8)
    inlet = open_inlet(ends[1])

    assert not inlet.wait(0.01)
    assert inlet.receive(room) == NOTHING
    inlet.close()
    outlet = open_outlet(ends[1])
    outlet.send(room)
    outlet.close()


def test_closing_twice_is_once_and_nothing_is_sent_after(linked):
    outlet, inlet = linked
    for end in (outlet, inlet, outlet, inlet):
        end.close()

    with pytest.raises(PublishError, match="was closed, nothing can be sent"):
        outlet.send(np.zeros(9, np.uint8))
    assert inlet.receive(np.zeros(9, np.uint8)) == NOTHING


def test_program_that_forgets_to_close_ends_without_a_word(ends):
    with open_publisher(ends[0]) as publisher, FarEnd("hold", ends[1], 2) as program:
        for _ in range(50):
            publisher.publish(touch(frame()))
        assert program.ended(let_go=True) == (0, "", "")


def test_search_by_multicast_prints_nothing_whether_it_works_or_not():
    with FarEnd("hold", f"zenoh://test/{os.getpid()}/searching") as program:
        assert program.said == "ready"
        assert program.ended(let_go=True) == (0, "", "")


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("zenoh://a//b", r"expected a key such as decaff/poses \(Invalid Key Expr `a//b`: empty chunks"),
        ("zenoh://a/*", "expected one key, without wildcards"),
        ("zenoh://a?connect=127.0.0.1", "Zenoh cannot open it .*Endpoints must be of the form"),
        ("zenoh://a?config=none.json5", "the configuration 'none.json5' is not there"),
        ("zenoh://a?from=here", r"there is no option 'from' \(expected connect, listen, config\)"),
    ],
)
def test_address_that_cannot_be_opened_is_refused(address, message):
    for opener in (open_outlet, open_inlet):
        with pytest.raises(PublishError, match=message) as refusal:
            opener(address)
        assert str(refusal.value).startswith(f"{address}: ")
        assert " at /" not in str(refusal.value)  # where in the source of Zenoh


def test_port_in_use_is_refused(ends):
    with open_publisher(ends[0]), pytest.raises(PublishError, match=r"Zenoh cannot open it .*TCP listener"):
        open_publisher(ends[0])


def test_without_the_library_the_error_says_what_to_install(monkeypatch):
    monkeypatch.delitem(sys.modules, "proximity.transport.zenoh", raising=False)
    monkeypatch.setitem(sys.modules, "zenoh", None)

    with pytest.raises(
        PublishError, match=r'zenoh://decaff: needs zenoh: pip install "cad-proximity\[zenoh\]"'
    ):
        open_publisher("zenoh://decaff")


# --- a configuration of Zenoh's own: who may publish ---

ACCESS = """{
  scouting: { multicast: { enabled: false } },
  transport: { auth: { usrpwd: { user: "service", password: "x", dictionary_file: "users" } } },
  access_control: {
    enabled: IS_ENABLED, default_permission: "deny",
    rules: [{ id: "poses", permission: "allow", flows: ["ingress", "egress"],
              messages: ["put", "declare_subscriber"], key_exprs: ["test/poses"] }],
    subjects: [{ id: "hand", usernames: ["glove"] }],
    policies: [{ rules: ["poses"], subjects: ["hand"] }],
  },
}"""


def numbers_taken(inlet, outlets, count, *, is_anybody=False):
    """Send each outlet's number for a second and until so many of the last came; how often which came."""
    room, taken, begun = np.zeros(1, np.uint8), Counter(), time.monotonic()

    def has_enough():
        for number, outlet in enumerate(outlets):
            outlet.send(np.full(1, number, np.uint8))
        inlet.wait(0.02)
        while inlet.receive(room) != NOTHING:
            taken[int(room[0])] += 1
        is_late = time.monotonic() - begun > 1.0  # who is let in at all has been by then
        return is_late and taken[len(outlets) - 1] >= count and (taken[0] or not is_anybody)

    until(has_enough)
    return taken


@pytest.mark.parametrize("is_enabled", [True, False])
def test_access_control_of_the_configuration_holds(tmp_path, monkeypatch, is_enabled):
    """Both know a password; only one of them may publish poses, where access is controlled at all."""
    monkeypatch.chdir(tmp_path)
    Path("users").write_text("service:x\nglove:g\nother:o\n")
    Path("service.json5").write_text(ACCESS.replace("IS_ENABLED", str(is_enabled).lower()))
    for user in ("glove", "other"):
        password = f'{{ user: "{user}", password: "{user[0]}" }}'
        Path(f"{user}.json5").write_text(f"{{ transport: {{ auth: {{ usrpwd: {password} }} }} }}")
    place = f"tcp/127.0.0.1:{free_tcp_port()}"
    inlet = open_inlet(f"zenoh://test/poses?config=service.json5&listen={place}")
    outlets = [
        open_outlet(f"zenoh://test/poses?config={user}.json5&connect={place}") for user in ("other", "glove")
    ]
    taken = numbers_taken(inlet, outlets, 20, is_anybody=not is_enabled)
    for end in (inlet, *outlets):
        end.close()

    assert set(taken) == ({1} if is_enabled else {0, 1})


def test_configuration_of_the_readme_lets_one_certificate_publish(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make_certificates("service", "glove", "other")
    text = PAGES["guide/security.md"].split("```json5\n")[1].split("```")[0]
    Path("service.json5").write_text(text)
    for name in ("glove", "other"):
        Path(f"{name}.json5").write_text(
            text.split("  access_control")[0].replace("service.", f"{name}.") + "}"
        )
    place = f"tls/localhost:{free_tcp_port()}"
    inlet = open_inlet(f"zenoh://decaff/poses?config=service.json5&listen={place}")
    outlets = [
        open_outlet(f"zenoh://decaff/poses?config={name}.json5&connect={place}")
        for name in ("other", "glove")
    ]
    taken = numbers_taken(inlet, outlets, 20)
    for end in (inlet, *outlets):
        end.close()

    assert set(taken) == {1}


def make_certificates(*names):
    """A private authority, ca.pem, and for each name a certificate of localhost, in this folder."""
    if shutil.which("openssl") is None:
        pytest.skip("there is no openssl to make certificates with")
    key = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -keyout"
    commands = [f"req -x509 {key} ca.key -out ca.pem -days 2 -subj /CN=ca"]
    Path("names").write_text("subjectAltName=DNS:localhost")
    for name in names:
        commands.append(f"req {key} {name}.key -out {name}.csr -subj /CN={name}")
        signed = "-CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -extfile names"
        commands.append(f"x509 -req -in {name}.csr -out {name}.pem {signed}")
    for command in commands:
        subprocess.run(["openssl", *command.split()], check=True, capture_output=True, timeout=60)


def free_tcp_port():
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        return held.getsockname()[1]
