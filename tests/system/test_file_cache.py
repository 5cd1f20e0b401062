"""Cached contents: the newest are kept; damaged ones and other users' are not read."""

import os
import threading

import pytest

from proximity.system.file_cache import FOLDER_VARIABLE, FileCache


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache" / "parts"


def test_what_was_kept_is_there_for_another_process(folder):
    FileCache("parts", 1000).write("a", b"content")
    assert FileCache("parts", 1000).read("a") == b"content"
    assert FileCache("parts", 1000).read("b") is None
    assert FileCache("others", 1000).read("a") is None


def test_min_recently_used_go_beyond_the_limit(folder):
    cache = FileCache("parts", 300)
    for number, key in enumerate("abc"):
        cache.write(key, bytes(50))
        os.utime(folder / f"{key}.kept", (number, number))
    assert cache.read("a") is not None  # used last
    cache.write("d", bytes(50))
    assert [key for key in "abcd" if cache.read(key) is not None] == ["a", "c", "d"]
    cache.write("e", bytes(400))
    assert cache.read("e") is None and cache.read("d") is not None, "what is too large is not kept"


@pytest.mark.parametrize("damage", [lambda data: data[:-1], lambda data: data[:-1] + b"x", lambda data: b""])
def test_damaged_content_is_not_read_and_can_be_kept_again(folder, damage):
    cache = FileCache("parts", 1000)
    cache.write("a", b"content")
    (path,) = folder.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    assert cache.read("a") is None and not path.exists()
    cache.write("a", b"content")
    assert cache.read("a") == b"content"


def test_folder_that_cannot_be_made_keeps_nothing(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "file"))
    cache = FileCache("parts", 1000)
    cache.write("a", b"content")
    assert cache.read("a") is None and cache.kept_count == 0


@pytest.mark.skipif(os.name == "nt", reason="modes are of POSIX")
def test_folder_that_others_may_write_to_is_not_used(folder):
    cache = FileCache("parts", 1000)
    cache.write("a", b"content")
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o777)
    assert cache.read("a") is None
    cache.write("b", b"content")
    assert not (folder / "b.kept").exists()


def test_many_may_write_and_read_one_key(folder):
    contents = [bytes([number]) * 100_000 for number in range(4)]
    found, is_over = [], threading.Event()

    def read():
        while not is_over.is_set():
            found.append(FileCache("parts", 300_000).read("a"))

    def write(content):
        for _ in range(10):
            FileCache("parts", 300_000).write("a", content)

    reader = threading.Thread(target=read)
    writers = [threading.Thread(target=write, args=(content,)) for content in contents]
    for thread in (reader, *writers):
        thread.start()
    for writer in writers:
        writer.join()
    is_over.set()
    reader.join()
    assert {None, *contents} >= set(found) and found[-1] in contents
