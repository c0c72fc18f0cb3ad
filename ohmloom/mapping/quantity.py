"""A number in a hardware spec: its value in SI, where it comes from and, if it is assumed, how far it may be off."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from ohmloom._files import StrictModel

ASSUMED = "assumed"


class Quantity(StrictModel):
    """A value with its source.

    Attributes
    ----------
    value
        In SI units; the unit is the field's.
    source
        A citation, a data sheet, ``definition``, or a text that begins with ``assumed``.
    range
        Lowest and highest plausible value; required of an assumed one.
    """

    value: float
    source: str = Field(min_length=1)
    range: tuple[float, float] | None = Field(default=None, strict=False)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.is_assumed and self.range is None:
            raise ValueError("a range = [low, high], since the source is 'assumed'")
        if self.range is not None and not self.range[0] <= self.value <= self.range[1]:
            raise ValueError(f"a range around the value {self.value:g}")
        return self

    @property
    def is_assumed(self) -> bool:
        """Whether nobody but us stands behind this value."""
        return self.source.strip().lower().startswith(ASSUMED)

    @property
    def extremes(self) -> tuple[float, ...]:
        """Values at which a figure is tried: both ends of the range of an assumed value, else the value itself."""
        return self.range if self.is_assumed and self.range is not None else (self.value,)


def _positive(quantity: Quantity) -> Quantity:
    if not all(v > 0.0 for v in (quantity.value, *(quantity.range or ()))):
        raise ValueError(f"a value and range > 0, not {quantity.value:g}")
    return quantity


def _not_negative(quantity: Quantity) -> Quantity:
    if not all(v >= 0.0 for v in (quantity.value, *(quantity.range or ()))):
        raise ValueError(f"a value and range >= 0, not {quantity.value:g}")
    return quantity


def _fraction(quantity: Quantity) -> Quantity:
    if not all(0.0 <= v <= 1.0 for v in (quantity.value, *(quantity.range or ()))):
        raise ValueError(f"a value and range in [0, 1], not {quantity.value:g}")
    return quantity


def _count(quantity: Quantity) -> Quantity:
    if not all(v >= 1.0 and v == int(v) and v <= 32 for v in (quantity.value, *(quantity.range or ()))):
        raise ValueError(f"a whole number from 1 to 32, not {quantity.value:g}")
    return quantity


Positive = Annotated[Quantity, AfterValidator(_positive)]
NotNegative = Annotated[Quantity, AfterValidator(_not_negative)]
Fraction = Annotated[Quantity, AfterValidator(_fraction)]
Count = Annotated[Quantity, AfterValidator(_count)]
