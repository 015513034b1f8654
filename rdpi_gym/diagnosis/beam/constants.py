"""The numbers of the search, each with its unit, its meaning and where it is from: one table."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Constant:
    """One number that the search does not take from the data."""

    name: str
    value: float
    unit: str
    meaning: str
    source: str


FOLDS = 16
FEWEST_BLOCKS = 8
MOST_BLOCKS = 32
BLOCK_LENGTHS = 1.0
DRAWS = 500
LEVEL = 0.05
TEMPERATURE = 4.0
BEAM = 3
LEAST_WEIGHT = 0.05
EXPANDED = 18
RACE_SAMPLES = 6_000
RACE_STEPS = 6
ROUNDS = 3
FOLLOWED = 2
LOOKED = 6
REFITTED = 4
PAIRS = 4
FIT_SAMPLES = 24_000
READ_SAMPLES = 48_000
PASSES = 15
RIDGE = 1e-6
FOUND = 0.9
LIKELY = 0.5
TAKES = -0.5

TABLE: tuple[Constant, ...] = (
    Constant("FOLDS", FOLDS, "stretches of a record", "left out in turn by the cross-fit",
             "as blocks held out of a single record"),
    Constant("FEWEST_BLOCKS", FEWEST_BLOCKS, "blocks of a record", "however long its residual is correlated",
             "a bootstrap of fewer has no spread"),
    Constant("MOST_BLOCKS", MOST_BLOCKS, "blocks of a record", "however short its residual is correlated",
             "more change no interval and cost time"),
    Constant("BLOCK_LENGTHS", BLOCK_LENGTHS, "correlation lengths", "length of a block",
             "Künsch 1989: blocks longer than the correlation"),
    Constant("DRAWS", DRAWS, "draws", "of the bootstrap", "standard error of 1 % at a level of 5 %"),
    Constant("LEVEL", LEVEL, "1", "chance that any of the looks, free blocks or openings is taken without a reason", "convention"),
    Constant("TEMPERATURE", TEMPERATURE, "nats over nats", "divides the sum of the scores; 2 would be the "
             "Gaussian likelihood with one independent value a block, were models true",
             "names of 80 plants, studies.one_law of 40 at seeds 21 and 22: log loss 2.6 nats a plant at 2, 2.3 at "
             "4, 1.7 to 1.8 from 11 to 32; the largest at which no name that is there is lost"),
    Constant("BEAM", BEAM, "sets", "of which the first that may grow goes on; and effects in a row, added to one, that "
             "each take less than is left", "three to five; and no plant of the studies hides more effects"),
    Constant("LEAST_WEIGHT", LEAST_WEIGHT, "1", "of a set that goes on", "less moves no probability by 5 %"),
    Constant("EXPANDED", EXPANDED, "sets", "whose moves are looked at, at most",
             "the beam, for each of twice the effects that a plant of the studies has"),
    Constant("RACE_SAMPLES", RACE_SAMPLES, "samples", "in the squares of a first look",
             "a hundred for each number"),
    Constant("RACE_STEPS", RACE_STEPS, "steps", "of Gauss-Newton in a first look, at most",
             "chosen for creeps of three time constants; studies.search_constants halves and doubles it"),
    Constant("ROUNDS", ROUNDS, "rounds", "of a refit with a clock fault; halvings of the distance between two starts at a cusp, and again",
             "a fiftieth of it: valleys of a slew limit are half a percent wide"),
    Constant("LOOKED", LOOKED, "effects", "that are looked at, of those that promise most", "the beam twice"),
    Constant("FOLLOWED", FOLLOWED, "free blocks", "that are looked at, of those that promise most", "the two that are near"),
    Constant("REFITTED", REFITTED, "moves", "of a set that are refitted whole", "the beam and one more"),
    Constant("PAIRS", PAIRS, "pairs", "of effects that are looked at", "as many as are refitted"),
    Constant("FIT_SAMPLES", FIT_SAMPLES, "samples", "in the squares of a refit", "a thousand for each number"),
    Constant("READ_SAMPLES", READ_SAMPLES, "samples", "that a search reads where there are twice as many",
             "twice those of a refit; the model that is found is refitted to all"),
    Constant("PASSES", PASSES, "passes", "of a refit", "later ones gain less than a thousandth"),
    Constant("RIDGE", RIDGE, "1", "share of a number's curvature that keeps it where no record tells it",
             "square root of the precision of differences"),
    Constant("FOUND", FOUND, "1", "least probability of a name that is found", "the release's definition"),
    Constant("LIKELY", LIKELY, "1", "least probability of a likely name, or one that takes its weight", "more likely than not"),
    Constant("TAKES", TAKES, "1", "correlation of weights from which on two names are one class",
             "half of a name's variance is the other's"),
)  # fmt: skip
"""All of them."""
