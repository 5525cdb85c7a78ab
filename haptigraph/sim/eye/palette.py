"""The phantom's appearance: its styles and their colours."""

from typing import Annotated, Literal, TypeAlias

from msgspec import Meta, Struct
from msgspec.structs import replace

__all__ = ["BLOOD", "LAYER", "PALETTES", "Appearance", "Color", "Palette"]

Level: TypeAlias = Annotated[float, Meta(ge=0, le=255)]
Color: TypeAlias = tuple[Level, Level, Level]
"""Blue, green, red, each 0 to 255."""


class Appearance(Struct, frozen=True, forbid_unknown_fields=True):
    """The [appearance] table of a scenario."""

    style: Literal["light", "dark"] = "light"
    """Light: a white print and a darker needle. Dark: a painted fundus and a brighter needle."""
    texture: float = 1.0
    """Strength of print lines and stains; 0: smooth surfaces."""
    bowl_bgr: Color | None = None
    """Colour of the bowl, all over; unset: the style's."""
    bowl_shade: Annotated[float, Meta(ge=0, le=1)] | None = None
    """Brightness of the bowl's top relative to its bottom; unset: the style's."""

    @property
    def palette(self) -> "Palette":
        """The style's colours, with those of the bowl that are set."""
        palette = PALETTES[self.style]
        if self.bowl_bgr is not None:
            palette = replace(palette, bowl=self.bowl_bgr, fundus=None)
        return palette if self.bowl_shade is None else replace(palette, bowl_shade=self.bowl_shade)


LAYER: Color = (150, 160, 214)
BLOOD: Color = (24, 18, 150)


class Palette(Struct, frozen=True):
    """The colours of one style."""

    skin: Color
    recess: Color
    ledge: Color
    tube: Color
    wall: Color
    bowl: Color
    bowl_shade: float
    """Brightness of the bowl's top relative to its bottom."""
    fundus: Color | None
    vessel: Color
    hole: Color


PALETTES = {
    "light": Palette(
        skin=(104, 122, 142),
        recess=(62, 72, 84),
        ledge=(112, 132, 158),
        tube=(98, 106, 90),
        wall=(200, 205, 205),
        bowl=(184, 196, 197),
        bowl_shade=0.82,
        fundus=None,
        vessel=(0, 0, 0),
        hole=(92, 104, 112),
    ),
    "dark": Palette(
        skin=(128, 148, 176),
        recess=(52, 58, 66),
        ledge=(140, 164, 196),
        tube=(168, 92, 120),
        wall=(190, 184, 178),
        bowl=(72, 68, 66),
        bowl_shade=0.55,
        fundus=(40, 52, 96),
        vessel=(38, 52, 128),
        hole=(150, 150, 148),
    ),
}
