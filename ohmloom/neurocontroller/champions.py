"""The champions that come with ohmloom: one evolved network per system."""

from __future__ import annotations

from importlib import resources

from ohmloom.errors import MissingFileError, UnknownNameError, expect_type
from ohmloom.neurocontroller.kinds import SYSTEMS
from ohmloom.neurocontroller.network import Network


def champion(system: str) -> Network:
    """The shipped champion of a system: HP, PEO, LIN, GA or HET.

    Raises
    ------
    UnknownNameError
        If there is no such system.

    Examples
    --------
    >>> champion("GA").system
    'GA'
    """
    expect_type("champion", system, str)
    if system not in SYSTEMS:
        raise UnknownNameError.of("champion", system, SYSTEMS)
    file = resources.files("ohmloom.neurocontroller") / "champions" / f"{system}.net.json"
    try:
        data = file.read_bytes()
    except OSError as error:
        raise MissingFileError(
            f"{file}: expected a shipped network, got {error.strerror}. Install ohmloom again."
        ) from error
    return Network.from_json(data, f"{system}.net.json", name=system)
