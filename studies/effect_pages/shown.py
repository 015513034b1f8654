"""How each effect is shown: as its file declares, or as any effect is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rdpi_gym.plant.effects import CATALOGUE, Effect, Look, Picture
from rdpi_gym.virtual_lab import HIDEABLE
from studies.effect_pages.panels import PANELS
from studies.effect_pages.picture import Panel
from studies.effect_pages.study import Study

ANY = Picture(
    {},
    Look("loops", "A large sine of 10 Hz", "sine-10hz"),
    Look("left_over_command", "What a refit leaves of it", "sine-10hz"),
)
"""The picture of an effect that declares none."""


@dataclass(frozen=True)
class Shown:
    """How an effect is shown.

    Parameters
    ----------
    picture
        What it declares.
    """

    picture: Picture

    @property
    def values(self) -> Mapping[str, float]:
        """Parameters that are not at their defaults."""
        return self.picture.values

    def panels(self, study: Study) -> tuple[Panel, Panel]:
        """Left and right, of a study of the effect."""
        left, right = (
            PANELS[look.kind](study, look.title, *look.arguments)
            for look in (self.picture.left, self.picture.right)
        )
        return left, right


def shown(kind: type[Effect]) -> Shown:
    """Return how an effect is shown."""
    return Shown(kind.picture or ANY)


SHOWN: dict[str, Shown] = {
    name: shown(kind)
    for name, kind in CATALOGUE.items()
    if kind.__module__.startswith("rdpi_gym.") and name in HIDEABLE
}
"""The effects of the package that the virtual laboratory can simulate, by name."""
