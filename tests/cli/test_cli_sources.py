"""``proximity client`` and ``controller``: written sources, files left unchanged, and errors."""

import json
from itertools import chain

import pytest

import proximity
from proximity import ProximityError
from proximity.cli.service.sources import CLIENTS
from proximity.clients import CSHARP, EXAMPLES, c_package, client_files
from proximity.decaff.controller.chip_sources import controller_sources
from proximity.decaff.controller.settings import CableRule, ControllerSettings
from proximity.decaff.glove.glove import DRUMS, Glove

SETTINGS = ControllerSettings(2000.0, DRUMS["gear14"])


def not_compiled():
    raise ProximityError("the library has not been compiled")


@pytest.mark.parametrize(
    ("words", "sources"),
    [
        *((["client", name], client_files(language)) for name, (language, _) in CLIENTS.items()),
        (["library", "csharp"], client_files("csharp", "client")),
        (["controller", "--drum", "gear14", "--rate", 2000], controller_sources([Glove()], SETTINGS)),
        (["controller", "--cable", 1212],
         controller_sources([Glove()], ControllerSettings(cable=CableRule(1212.0)))),
    ],
    ids=lambda value: " ".join(map(str, value[:2])) if isinstance(value, list) else "",
)  # fmt: skip
def test_sources_are_written_and_examples_are_left_alone(run, words, sources, tmp_path, monkeypatch):
    monkeypatch.setattr(c_package, "library_path", not_compiled)
    folder = tmp_path / "a" / "b"
    result = run(*words, "--out", folder)
    files = {
        path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8")
        for path in folder.rglob("*")
        if path.is_file()
    }
    assert (result.code, result.err, files) == (0, "", sources)
    assert result.out.splitlines() == [f"{folder / name}: written" for name in sources]

    for name in files:
        (folder / name).write_text("mine")
    again = run(*words, "--out", folder).out.splitlines()

    kept = {name for name in files if (folder / name).read_text(encoding="utf-8") == "mine"}
    assert kept == EXAMPLES & set(files)
    assert all(f"{folder / name}: kept, as it exists already" in again for name in kept)


def test_package_for_unity_has_the_library_that_was_compiled(run, tmp_path, monkeypatch):
    (tmp_path / "proximity.dll").write_bytes(b"library")
    monkeypatch.setattr(c_package, "library_path", lambda: tmp_path / "proximity.dll")

    result = run("library", "csharp", "--out", tmp_path / "package")

    plugin = tmp_path / "package" / "Runtime" / "Plugins" / "proximity.dll"
    assert plugin.read_bytes() == b"library" and f"{plugin}: written" in result.out
    assert json.loads((tmp_path / "package" / "package.json").read_text())["version"] == proximity.__version__


def test_stiffness_of_the_cable_is_a_number_in_the_sources(run, tmp_path):
    run("controller", "--out", tmp_path, "--cable", 1212)

    assert ".cable_stiffness = 1212.0,\n" in (tmp_path / "decaff_glove.c").read_text(encoding="ascii")


def test_file_that_cannot_be_written_is_told(run, tmp_path):
    (tmp_path / "proximity_client.hpp").mkdir()

    result = run("client", "cpp", "--out", tmp_path)

    assert result.code == 2
    assert result.err == (
        f"proximity: {tmp_path}/proximity_client.hpp: cannot be written (it is not a regular file)\n"
    )


def test_client_and_library_in_csharp_are_two_that_one_folder_can_hold():
    client, library = client_files("csharp"), client_files("csharp", "client")

    assert {name: library[name] for name in library if name in client} == {
        name: client[name] for name in client if name in library
    }
    assert {"Runtime/ProximityClient.cs", "Runtime/ProximityHand.cs"} <= client.keys() - library.keys()
    assert sorted(path.rpartition("/")[2] for path in client.keys() ^ library.keys()) == sorted(
        chain(*CSHARP.values())
    )
    assert "Examples~/Imported.cs" in library
