"""The C text of ideal laws' fluxes and of their inverses, in the order of the laws' own operations; and of flows."""

from __future__ import annotations

from collections.abc import Iterable

from ohmloom.devices import Device

# phi(s) in Wb, and the s of a flux where it has a closed form; parameters as the law declares them.
FLUXES = {
    "hp_linear": """static double hp_linear_flux(double s, const double *p)
{
    const double q_d = (p[1] - p[0]) / (p[1] * p[0] * p[2]);
    return q_d * s * (p[1] - 0.5 * (p[1] - p[0]) * s);
}
""",
    "linear": """static double linear_flux(double s, const double *p)
{
    return p[2] * p[0] * p[1] / (p[1] - p[0]) * log1p((p[1] / p[0] - 1.0) * s);
}
""",
    "peo_pani_mirror": """static double peo_pani_mirror_flux(double s, const double *p)
{
    const double total = 1.0 / p[0] + 1.0 / p[1], growth = total * (p[1] - p[0]) * s;
    return p[2] / (p[1] - p[0]) / (total * total) * (growth + log1p(growth * p[1] / p[0]));
}
""",
}
INVERSES = {
    "hp_linear": """static double hp_linear_state_at_flux(double phi, const double *p)
{
    const double scaled = phi / ((p[1] - p[0]) / (p[1] * p[0] * p[2]));
    return 2.0 * scaled / (p[1] + sqrt(p[1] * p[1] - 2.0 * (p[1] - p[0]) * scaled));
}
""",
    "linear": """static double linear_state_at_flux(double phi, const double *p)
{
    return expm1(phi * (p[1] - p[0]) / (p[2] * p[0] * p[1])) / (p[1] / p[0] - 1.0);
}
""",
}


# The change of charge that a flux makes from s, walls aside; by the change itself, so that small ones are not rounded.
FLOWS = {
    "hp_linear": """static double hp_linear_flow(double s, double phi, const double *p)
{
    const double m = p[1] - (p[1] - p[0]) * s; /* its square falls in proportion to the flux */
    const double after = m * m - 2.0 * p[0] * p[1] * p[2] * phi;
    return after > 0.0 && after < INFINITY ? 2.0 * phi / (m + sqrt(after)) : phi > 0.0 ? INFINITY : -INFINITY;
}
""",
    "linear": """static double linear_flow(double s, double phi, const double *p)
{
    const double g = 1.0 / p[1] + (1.0 / p[0] - 1.0 / p[1]) * s, k = (1.0 / p[0] - 1.0 / p[1]) / p[2];
    return g / k * expm1(k * phi);
}
""",
}


def flux_code(devices: list[Device], is_plastic: list[bool], *, has_flux: bool, has_inverse: bool) -> list[str]:
    """``flux(tile, s)`` in Wb of the plastic devices of each tile, and ``state_at_flux(tile, phi)``, its inverse."""
    chosen = [(t, device.law) for t, device in enumerate(devices) if is_plastic[t]]
    laws = list(dict.fromkeys(law for _, law in chosen))
    lines: list[str] = []
    if has_flux:
        lines += [FLUXES[law] for law in laws]
        lines += _dispatch("flux", "s", "Wb, the integral of 1/G over the charge up to s, of a tile's devices",
                           [(t, f"{law}_flux(s, tile_p_{t})") for t, law in chosen])  # fmt: skip
    if has_inverse:
        lines += [INVERSES[law] for law in laws if law in INVERSES]
        lines += ["static double invert_flux(int t, double phi);", ""] if set(laws) - set(INVERSES) else []
        lines += _dispatch("state_at_flux", "phi", "the state of a flux", [
            (t, f"{law}_state_at_flux(phi, tile_p_{t})" if law in INVERSES else f"invert_flux({t}, phi)")
            for t, law in chosen
        ])  # fmt: skip
    return lines


def _dispatch(name: str, argument: str, doc: str, calls: Iterable[tuple[int, str]]) -> list[str]:
    """A function of the tile and of one more argument; NaN for tiles whose devices do not move."""
    cases = [line for t, call in calls for line in (f"    case {t}:", f"        return {call};")]
    head = [f"/* {doc} */", f"static double {name}(int tile, double {argument})", "{", "    switch (tile) {"]
    return [*head, *cases, "    default:", f"        return NAN * {argument};", "    }", "}", ""]
