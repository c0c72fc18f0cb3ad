"""An FMU file as it comes from elsewhere: looked at before anything is unpacked."""

from __future__ import annotations

import re
import stat
import zipfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from ohmloom._files import DAMAGED_ZIP
from ohmloom.errors import FileFormatError, MissingFileError, expect_type, shown
from ohmloom.fmu._compile import TARGETS, host

LARGEST_CONTENT = 1_000_000_000  # bytes when unpacked; a large FMU has 100 MB
LARGEST_DESCRIPTION = 100_000_000
MOST_ENTRIES = 20_000
HIGHEST_RATIO = 500  # of unpacked to packed bytes of one entry; text packs 10 to 50 times
SMALL = 10_000_000  # bytes; what unpacks to less is no bomb at any ratio


@dataclass(frozen=True, kw_only=True)
class Archive:
    """What can be said of an FMU file without running it.

    Attributes
    ----------
    path
        The file.
    fmi
        2 or 3.
    interfaces
        Identifier of the library by interface, ``"ModelExchange"`` and ``"CoSimulation"``.
    names
        The files inside.
    """

    path: Path
    fmi: int
    interfaces: dict[str, str]
    names: tuple[str, ...]

    def library(self, interface: str) -> str:
        """The library's name inside the archive, for this machine.

        Raises
        ------
        FileFormatError
            If the FMU has no such interface, or no library for this machine.
        """
        if interface not in self.interfaces:
            raise FileFormatError(f"{self.path}: expected an FMU for {interface}, got one for "
                                  f"{', '.join(self.interfaces)}. Choose that interface.")  # fmt: skip
        target = TARGETS.get(host())
        name = f"binaries/{target.folder(self.fmi)}/{self.interfaces[interface]}{target.ending}" if target else ""
        if name in self.names:
            return name
        there = sorted({name.split("/")[1] for name in self.names if re.match(r"binaries/[^/]+/", name)})
        raise FileFormatError(f"{self.path}: expected a library for {host()}, {name}, got "
                              f"{', '.join(there) or 'none'}. Export it for this platform.")  # fmt: skip

    def extract(self, folder: Path) -> None:
        """Unpack into `folder`, which is empty.

        Raises
        ------
        FileFormatError
            If an entry is damaged.
        """
        try:
            with zipfile.ZipFile(self.path) as file:
                file.extractall(folder)
        except (OSError, *DAMAGED_ZIP) as error:
            raise FileFormatError(f"{self.path}: expected a whole zip file, got {error}. Fetch it again.") from error


def open_archive(path: Path | str) -> Archive:
    """Look at an FMU file; nothing is unpacked to disk, nothing of it runs.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is no zip file, or a bomb; if an entry leads out of the folder, is a link, is encrypted or stands there
        twice; if its description is missing, damaged, or of another version than 2.0 or 3.0.
    """
    expect_type("FMU file", path, str, Path, name="a path")
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: expected an FMU file, got none. Check the path.")
    try:
        with zipfile.ZipFile(path) as file:
            entries = file.infolist()
            check_entries(path, entries)
            if "SystemStructure.ssd" in file.namelist():
                raise FileFormatError(f"{path}: expected an FMU, got a system of FMUs (SSP). Run it by "
                                      "run_ssp.")  # fmt: skip
            if "modelDescription.xml" not in file.namelist():
                raise FileFormatError(f"{path}: expected modelDescription.xml inside, got no such entry. "
                                      "Check that this is an FMU.")  # fmt: skip
            if file.getinfo("modelDescription.xml").file_size > LARGEST_DESCRIPTION:
                limit = LARGEST_DESCRIPTION // 10**6
                raise FileFormatError(f"{path}:modelDescription.xml: expected at most {limit} MB, got more. "
                                      "Check that this is an FMU.")  # fmt: skip
            text = file.read("modelDescription.xml")
    except DAMAGED_ZIP as error:
        raise FileFormatError(f"{path}: expected a zip file, got {error}. Check that this is an FMU.") from error
    except OSError as error:
        raise MissingFileError(f"{path}: expected a file that can be read, got {error.strerror}. Check it.") from error
    fmi, interfaces = _read_description(path, text)
    return Archive(path=path, fmi=fmi, interfaces=interfaces, names=tuple(entry.filename for entry in entries))


def check_entries(path: Path, entries: list[zipfile.ZipInfo]) -> None:
    """Refuse a zip file that would do harm when it is unpacked.

    Raises
    ------
    FileFormatError
        If it is a bomb, or an entry leads out of its folder, is a link, is encrypted or stands there twice.
    """

    def refuse(rule: str, got: str, advice: str = "Do not use this file.") -> None:
        raise FileFormatError(f"{path}: expected {rule}, got {got}. {advice}")

    if len(entries) > MOST_ENTRIES:
        refuse(f"at most {MOST_ENTRIES} entries", str(len(entries)))
    if sum(entry.file_size for entry in entries) > LARGEST_CONTENT:
        refuse(f"at most {LARGEST_CONTENT // 10**6} MB when unpacked", "more")
    seen = set()
    for entry in entries:
        name = entry.orig_filename
        parts = name.split("/")
        if name.startswith("/") or ".." in parts or "\\" in name or ":" in name or "\0" in name:
            refuse("entries inside the archive's own folder", shown(name))
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            refuse("files and folders", f"a link or device, {shown(name)}")
        if entry.flag_bits & 0x1:
            refuse("entries without a password", shown(name), "Unpack it with the password, and pack it again.")
        if entry.file_size > SMALL and entry.file_size > HIGHEST_RATIO * max(entry.compress_size, 1):
            refuse(f"entries that unpack to at most {HIGHEST_RATIO} times their size", shown(name))
        if name.lower() in seen:
            refuse("each entry once", f"{shown(name)} twice")
        seen.add(name.lower())


def parse_xml(where: str, text: bytes) -> ElementTree.Element:
    """The root of an XML file of somebody else's; `where` names it in errors.

    Raises
    ------
    FileFormatError
        If it is no XML, or declares a document type, whose entities could grow without bound.
    """
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise FileFormatError(f"{where}: expected no document type, got one. Do not use this file.")
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise FileFormatError(f"{where}: expected XML, got {error}. The file may be damaged.") from error


def _read_description(path: Path, text: bytes) -> tuple[int, dict[str, str]]:
    where = f"{path}:modelDescription.xml"
    root = parse_xml(where, text)
    version = root.get("fmiVersion", "")
    if root.tag != "fmiModelDescription" or not re.fullmatch(r"2\.0|3\.0(\..*|-.*)?", version):
        raise FileFormatError(f"{where}: expected fmiVersion 2.0 or 3.0, got {shown(version)}. "
                              "Export it in one of these.")  # fmt: skip
    interfaces = {}
    for interface in ("ModelExchange", "CoSimulation"):
        element = root.find(interface)
        if element is not None:
            identifier = element.get("modelIdentifier", "")
            if not re.fullmatch(r"[A-Za-z_]\w*", identifier, re.ASCII):
                raise FileFormatError(f"{where}: {interface}: expected a modelIdentifier that is a name in C, "
                                      f"got {shown(identifier)}. Correct it.")  # fmt: skip
            interfaces[interface] = identifier
    if not interfaces:
        raise FileFormatError(f"{where}: expected ModelExchange or CoSimulation, got neither. "
                              "Other interfaces are not run here.")  # fmt: skip
    return int(version[0]), interfaces
