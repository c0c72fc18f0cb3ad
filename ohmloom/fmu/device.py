"""One memristor as an FMU: voltage in, current, charge, memristance and weight out."""

from __future__ import annotations

from pathlib import Path

from ohmloom.devices import LAWS, Device
from ohmloom.errors import ParameterError, expect_number, expect_type
from ohmloom.fmu._compile import Platforms
from ohmloom.fmu._device_code import device_code, device_description
from ohmloom.fmu._flux_code import FLOWS
from ohmloom.fmu.build import Export, build, check_options
from ohmloom.fmu.description import FmiVersion


def export_device(
    device: Device,
    out: Path | str,
    *,
    fmi: FmiVersion = 2,
    platforms: Platforms = "host",
    q0: float | None = None,
) -> Export:
    """Write `device` as an FMU for model exchange and co-simulation.

    In: `v` in V, of the first terminal above the second. Out: `i` in A, positive into the first terminal; `q` in C,
    the state charge ``s q_d``; `memristance` in Ohm and `weight` ``G/G_on``, both at vanishing voltage. Parameters:
    those of the card, tunable, and `q0`, the charge at the start. The charge stops exactly at 0 and q_d, which are
    events, and leaves when the drive turns. Inputs are held over a communication step, which is exact for laws with a
    closed form; for others each of its inner steps has an error of at most the tolerance (1e-8 unless the importer sets
    it) times q_d.

    Parameters
    ----------
    device
        Any law and card.
    out
        The file, ``*.fmu``.
    fmi
        2 for FMI 2.0, 3 for FMI 3.0.
    platforms
        ``"host"`` for this machine, by ``$CC``, gcc, clang or ziglang, or, without any, sources alone; ``"all"`` for
        linux and darwin on x86_64 and aarch64, and windows on x86_64, by ziglang.
    q0
        Charge at the start, in C. Default: where W = 0.5, or q_d/2 if the device has no such weight.

    Returns
    -------
    Export
        The path, the platforms, the token and the size.

    Raises
    ------
    ParameterError
        If an option is none of these, or `q0` is outside [0, q_d].
    OperationError
        If the compiler fails, or the file cannot be written.

    Examples
    --------
    >>> export_device(Device.load("hp_tio2"), "hp.zip")
    Traceback (most recent call last):
    ohmloom.errors.ParameterError: export_device: out: expected a file that ends in .fmu, got 'hp.zip'. Rename it.
    """
    expect_type("export_device: device", device, Device)
    path = check_options("export_device", out, fmi, platforms)
    q_d = device.charge_scale
    if q0 is None:
        half = device.weight(0.0) <= 0.5
        q0 = q_d * (device.state_at_weight(0.5) if half else 0.5)
    start = expect_number("export_device: q0", q0, "a charge in C")
    if not 0.0 <= start <= q_d:
        raise ParameterError(
            f"export_device: q0: expected 0 <= q0 <= q_d = {q_d:.15g} C, got {start:.15g} C. Correct it."
        )
    description = device_description(device, start)
    law = LAWS[device.law]
    paragraphs = [
        f"{law.name}: {law.doc}.",
        "i = G(s, v) v, dq/dt = charge rate(s, v, i), s = q/q_d in [0, 1]; the functions stand in sources/fmu.c. The "
        "charge q rests at 0 and at q_d while its rate points outward.",
        f"Card: {device.source} (sha256 {device.sha256}).",
        "Licence: Apache-2.0, see licenses/license.txt.",
    ]
    return build(path, description, device_code(device, description), paragraphs, fmi=fmi, platforms=platforms,
                 notes={name: f"; {text}" for name, text in device.sources.items()},
                 has_flow=law.name in FLOWS)  # fmt: skip
