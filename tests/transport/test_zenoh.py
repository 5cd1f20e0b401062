"""Zenoh's errors and configuration, over loopback: no test depends on multicast."""

import os
import shutil
import socket
import subprocess
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from far_end import FarEnd, until
from pages import PAGES
from ports import free_port

from proximity.errors import PublishError
from proximity.transport import open_inlet, open_outlet
from proximity.transport.link import NOTHING

pytest.importorskip("zenoh", reason="eclipse-zenoh, of the extra zenoh, is not installed")


def free_place(protocol="tcp/127.0.0.1"):
    return f"{protocol}:{free_port(kind=socket.SOCK_STREAM)}"


def test_session_that_has_ended_is_a_sentence():
    inlet = open_inlet(f"zenoh://test/ended?listen={free_place()}")
    inlet._session.close()
    for receive in (lambda: inlet.receive(np.zeros(9, np.uint8)), lambda: inlet.wait(0.0)):
        with pytest.raises(PublishError, match=r"^zenoh://test/.*: cannot receive \("):
            receive()


def test_search_by_multicast_prints_nothing_whether_it_works_or_not():
    with FarEnd("hold", f"zenoh://test/{os.getpid()}/searching") as program:
        assert program.said == "ready"
        assert program.ended(let_go=True) == (0, "", "")


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("zenoh://a//b", r"expected a key such as proximity/poses \(Invalid Key Expr `a//b`: empty chunks"),
        ("zenoh://a/*", "expected one key, without wildcards"),
        ("zenoh://a?connect=127.0.0.1", "Zenoh cannot open it .*Endpoints must be of the form"),
        ("zenoh://a?config=none.json5", "the configuration 'none.json5' is not there"),
    ],
)
def test_address_that_cannot_be_opened_is_refused(address, message):
    for opener in (open_outlet, open_inlet):
        with pytest.raises(PublishError, match=message) as refusal:
            opener(address)
        assert str(refusal.value).startswith(f"{address}: ")
        assert " at /" not in str(refusal.value)  # a position in Zenoh's source


def test_port_in_use_is_refused():
    address = f"zenoh://test/taken?listen={free_place()}"
    outlet = open_outlet(address)
    with pytest.raises(PublishError, match=r"Zenoh cannot open it .*TCP listener"):
        open_outlet(address)
    outlet.close()


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
    """Send each outlet's number for 1 s and until *count* of the last arrived; count the arrivals."""
    room, taken, begun = np.zeros(1, np.uint8), Counter(), time.monotonic()

    def has_enough():
        for number, outlet in enumerate(outlets):
            outlet.send(np.full(1, number, np.uint8))
        inlet.wait(0.02)
        while inlet.receive(room) != NOTHING:
            taken[int(room[0])] += 1
        is_late = time.monotonic() - begun > 1.0  # accepted publishers have connected by then
        return is_late and taken[len(outlets) - 1] >= count and (taken[0] or not is_anybody)

    until(has_enough)
    return taken


@pytest.mark.parametrize("is_enabled", [True, False])
def test_access_control_of_the_configuration_holds(tmp_path, monkeypatch, is_enabled):
    """Both use a password; with access control enabled only one of them may publish poses."""
    monkeypatch.chdir(tmp_path)
    Path("users").write_text("service:x\nglove:g\nother:o\n")
    Path("service.json5").write_text(ACCESS.replace("IS_ENABLED", str(is_enabled).lower()))
    for user in ("glove", "other"):
        password = f'{{ user: "{user}", password: "{user[0]}" }}'
        Path(f"{user}.json5").write_text(f"{{ transport: {{ auth: {{ usrpwd: {password} }} }} }}")
    place = free_place()
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
    place = free_place("tls/localhost")
    inlet = open_inlet(f"zenoh://proximity/poses?config=service.json5&listen={place}")
    outlets = [
        open_outlet(f"zenoh://proximity/poses?config={name}.json5&connect={place}")
        for name in ("other", "glove")
    ]
    taken = numbers_taken(inlet, outlets, 20)
    for end in (inlet, *outlets):
        end.close()

    assert set(taken) == {1}


def make_certificates(*names):
    """Create a private authority, ca.pem, and a certificate of localhost for each name, in this folder."""
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
