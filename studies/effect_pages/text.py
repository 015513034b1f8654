"""The pages in words, from what the effects' files declare."""

from __future__ import annotations

from collections.abc import Mapping

from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.plant.effects.description import PLACES, page
from rdpi_gym.support.markdown import table
from studies.effect_pages.study import PICTURES, PLANT
from studies.effect_pages.tracking import CONTROLLER, tracking_text

INDEX = "README.md"
_MAKER = "python -m studies.effect_pages"
_BELOW = "**Trace in a residual:**"
_REMEDY = "**What to do:**"


def page_texts() -> dict[str, str]:
    """Return the text of every page by its file name: one for each effect, and the index."""
    kinds = {name: kind for name, kind in CATALOGUE.items() if name in PICTURES}
    pages = {f"{name}.md": effect_text(kind, PICTURES[name].values) for name, kind in kinds.items()}
    return {**pages, INDEX: index_text(kinds)}


def effect_text(kind: type[Effect], values: Mapping[str, float]) -> str:
    """Return the page of one effect."""
    drawn = kind().with_values(values)
    sizes = ", ".join(f"`{name}` = {value:.6g}" for name, value in drawn.values.items())
    picture = (
        f"![{kind.name} on an experiment that shows it]({kind.name}.png)\n\n"
        f"*The plant {PLANT} with {sizes}, without noise ([more about the pictures]({INDEX}#pictures)).*\n\n"
    )
    text = page(kind, level=1)
    text = text.replace(_BELOW, picture + _BELOW, 1)
    text = text.replace(_REMEDY, f"{tracking_text(kind.name)}\n\n{_REMEDY}", 1)
    for name in kind.mistaken_for:
        text = text.replace(f"`{name}`", f"[`{name}`]({name}.md)")
    source = kind.__module__.replace(".", "/") + ".py"
    return (
        f"{text}\n[All effects]({INDEX}). Made from [`{source}`](../../{source}) by `{_MAKER}`.\n"
    )


def index_text(kinds: Mapping[str, type[Effect]]) -> str:
    """Return the index."""
    lines = [
        "# Effects",
        "",
        "The physical effects that a plant can have, in the order of its chain. `rdpi effects` prints "
        "them, `rdpi diagnose` looks for them, and [one of your own](../own-effect.md) is one file more.",
    ]
    places: dict[str, list[type[Effect]]] = {}
    for kind in kinds.values():
        places.setdefault(PLACES[kind.slot], []).append(kind)
    for place, members in places.items():
        lines += [
            "",
            f"## Acts {place}",
            "",
            table(
                ["effect", "trace in a residual", "best experiment"],
                [[f"[`{k.name}`]({k.name}.md)", k.signature, k.experiment] for k in members],
                rule="tight",
            ),
        ]
    lines += [
        "",
        "## Pictures",
        "",
        f"Blue is the plant {PLANT} with the effect, grey the plant without it, on the experiment of the "
        "standard protocol that shows the effect best. *What a refit leaves* is the part that the bare model cannot "
        "take up once it has been fitted to the whole protocol: less than the effect itself, and of another shape. "
        "Everything is simulated as `rdpi simulate` does and fitted as `rdpi fit` does, without noise, with an "
        "effect large enough to be seen.",
    ]
    lines += [
        "",
        "## What the table of tracking errors shows",
        "",
        f"RMS error (µm) of `{CONTROLLER}` on {PLANT} with the parameters of the picture, open loop and without noise. "
        "The command is computed beforehand, once by an inverse that holds the plant without the effect and once by "
        "one that holds the plant itself. The sine has 50 Hz, 30 µm and 0.05 ms between samples, and is scored "
        "from its third period on; the staircase goes to 20, -10, 30, -30 and 0 µm in steps of 10 s with rises of 0.1 s, "
        "at 1 ms, and is scored as a whole. The rate is low-passed at 800 Hz as in the benchmark. What is left without the effect "
        "is the inverse's own error: it takes the rate of the reference for that of the command. The displacement scored is the one that the effect acts on, so for a sensor's lag it is the reading. All rows: "
        "[`studies/results/effect_tracking.csv`](../../studies/results/effect_tracking.csv).",
    ]
    lines += ["", f"Made from the effects' files by `{_MAKER}`.", ""]
    return "\n".join(lines)
