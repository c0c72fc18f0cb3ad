"""Files are written whole or not at all; wrong ones are named."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from ohmloom._files import StrictModel, check_format, parse_json, parse_toml, read_bytes, validate, write_atomic
from ohmloom.errors import FileFormatError, MissingFileError, OperationError, ParameterError, UnknownNameError


def test_a_file_is_replaced_whole(tmp_path):
    path = tmp_path / "new" / "a.json"
    write_atomic(path, "one")
    write_atomic(path, b"two")
    assert path.read_bytes() == b"two"
    assert os.listdir(path.parent) == ["a.json"]
    assert path.stat().st_mode & 0o777 == 0o644


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    write_atomic(path, "old")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OperationError) as caught:
        write_atomic(path, "new")
    assert str(caught.value) == (
        f"{path}: expected a file that can be written, got No space left on device. Check the folder."
    )
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.json"]


def test_a_killed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.json"
    write_atomic(path, "old")
    code = (
        "import os, sys\nfrom ohmloom._files import write_atomic\n"
        "os.fsync = lambda _: os._exit(9)\nwrite_atomic(sys.argv[1], 'new')"
    )
    assert subprocess.run([sys.executable, "-c", code, str(path)], check=False).returncode == 9
    assert path.read_text() == "old"


def test_reading_what_is_not_there(tmp_path):
    with pytest.raises(MissingFileError, match="expected a plan file, got No such file or directory"):
        read_bytes(tmp_path / "none", "plan")


class Inner(StrictModel):
    length: float


class Outer(StrictModel):
    inner: Inner
    parts: tuple[Inner, ...] = ()


@pytest.mark.parametrize(("table", "message"), [
    ({}, "F: inner: expected a value, got nothing. Add it."),
    ({"inner": {"lenght": 1.0, "length": 1.0}},
     "F: inner.lenght: expected no such key, got 1.0. Did you mean 'length'?"),
    ({"inner": {"length": 1.0}, "parts": ({"length": "1"},)},
     "F: parts[0].length: expected a valid number, got '1'. Correct it."),
    ({"inner": {"length": 1.0}, "parts": ({"length": 1.0, "lenth": 2},)},
     "F: parts[0].lenth: expected no such key, got 2. Did you mean 'length'?"),
])  # fmt: skip
def test_each_problem_names_its_field(table, message):
    with pytest.raises(FileFormatError) as caught:
        validate(Outer, table, "F")
    assert str(caught.value) == message


def test_models_made_in_python_give_the_house_error():
    for call, message in (
        (lambda: Inner(length="a"), "Inner.length: expected a valid number, got 'a'. Correct it."),
        (lambda: Outer(inner={"length": "a"}), "Outer.inner.length: expected a valid number, got 'a'. Correct it."),
        (lambda: Outer(inner=Inner(length=1.0), partz=1),
         "Outer.partz: expected no such key, got 1. Did you mean 'parts'?"),
        (lambda: Outer(), "Outer.inner: expected a value, got nothing. Add it."),
    ):  # fmt: skip
        with pytest.raises(ParameterError) as caught:
            call()
        assert str(caught.value) == message


def test_a_key_never_breaks_the_line():
    with pytest.raises(FileFormatError) as caught:
        validate(Inner, {"length": 1.0, "a\nb": 1}, "F")
    assert str(caught.value) == "F: 'a\\nb': expected no such key, got 1. Remove it."


@pytest.mark.parametrize(("parse", "text", "got"), [
    (parse_json, "1" * 5000, "an integer of thousands of digits"), (parse_json, "[" * 900 + "]" * 900, "nested too"),
    (parse_toml, "a = " + "1" * 5000, "an integer of thousands of digits"),
    (parse_toml, "a = " + "[" * 100000, "nested too"), (parse_toml, "a." * 100000 + "a = 1", "nested too"),
    (parse_toml, '"\\"" . ' * 100000 + "a = 1", "nested too"), (parse_toml, "[" + "a." * 100000 + "a]", "nested too"),
], ids=range(7))  # fmt: skip
def test_texts_that_no_parser_should_swallow(parse, text, got):
    with pytest.raises(FileFormatError, match=rf"^F: expected .*, got .*{got}.*\.") as caught:
        parse(text.encode(), "F")
    assert "\n" not in str(caught.value)


def test_a_text_that_is_deep_enough_for_us():
    assert parse_toml(b"a.b.c.d.e = '" + b"one. " * 1000 + b"'", "F")["a"]["b"]["c"]["d"]["e"].startswith("one.")


def test_a_file_larger_than_any_of_ours(tmp_path):
    path = tmp_path / "large"
    path.write_bytes(b" " * 11)
    assert len(read_bytes(path, "plan", limit=11)) == 11
    with pytest.raises(FileFormatError, match=r"large: expected a plan file of at most .*, got a larger one\."):
        read_bytes(path, "plan", limit=10)
    with pytest.raises(FileFormatError, match=r"^/dev/zero: expected a plan file of at most 16 MB"):
        read_bytes("/dev/zero", "plan")


@pytest.mark.parametrize("path", ["a\0b", "a" * 5000])
def test_names_that_no_file_can_have(tmp_path, path):
    with pytest.raises(MissingFileError, match=r"expected a plan file, got "):
        read_bytes(path, "plan")
    with pytest.raises(OperationError, match=r"expected a file that can be written, got "):
        write_atomic(tmp_path / path, "x")


def test_models_are_frozen():
    inner = Inner(length=1.0)
    with pytest.raises(ValueError, match="frozen"):
        inner.length = 2.0


def test_the_format_is_checked_first():
    assert check_format({"format": "f", "version": 2, "x": 1}, "F", "f", 2) == {"x": 1}
    with pytest.raises(FileFormatError, match=r"^F: version: expected 2, got 3\."):
        check_format({"format": "f", "version": 3}, "F", "f", 2)


def test_broken_text():
    with pytest.raises(
        FileFormatError, match=r"^F: expected JSON, got Expecting .* at line 1, column 9\. The file may"
    ):
        parse_json(b'{"a": 1,', "F")
    with pytest.raises(FileFormatError, match=r"^F: expected TOML, got "):
        parse_toml(b"a = ", "F")
    assert parse_toml(b"a = 1", "F") == {"a": 1}


def test_an_unknown_name_offers_the_nearest():
    error = UnknownNameError.of("Device.load", "hp_tio", ["hp_tio2", "peo_pani"])
    assert str(error) == "Device.load: expected one of hp_tio2, peo_pani, got 'hp_tio'. Did you mean 'hp_tio2'?"
    assert str(UnknownNameError.of("W", "zzz", ["abc"])).endswith("Use one of these.")
