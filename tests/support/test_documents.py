"""Documents: what is written is read back, and what is no value of an annotation is named by its place."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Literal, TypeVar

import numpy as np
import pytest

from rdpi_gym.support.checks import described
from rdpi_gym.support.documents import PLAIN, Document, Documents, at, stored
from rdpi_gym.support.errors import InputError
from tests.looping import over


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True)
class Part(Document):
    tau_s: float
    name: str = "lag"

    def __post_init__(self) -> None:
        if self.tau_s <= 0:
            raise InputError(f"tau_s is {self.tau_s}; give a time above 0 s")


@dataclass(frozen=True)
class Group:
    names: tuple[str, ...]


@dataclass(frozen=True)
class Whole(Document):
    parts: tuple[Part, ...]
    pair: tuple[float, float]
    groups: tuple[tuple[str, ...], ...]
    kind: Literal["a", "b"]
    colour: Colour
    count: int
    sure: bool | None
    either: Part | str
    numbers: Mapping[str, float | None]
    own: Part = field(metadata=stored(inline=True))
    rmse_um: float = field(metadata=stored("rmse", null=math.inf))
    anything: dict[str, Any] = field(default_factory=dict)
    here: int = field(default=3, metadata=stored(omitted=True))


WHOLE = Whole(
    (Part(1.0), Part(2.0, "resonance")), (0.0, 1.5), (("creep",), ()), "b", Colour.RED, 7, None,
    "no part", {"x": 1.0, "y": None}, Part(0.5, "own"), math.inf, {"array": np.arange(2)},
)  # fmt: skip


def written(whole: Whole = WHOLE) -> dict[str, Any]:
    return dict(json.loads(json.dumps(whole.to_dict(), allow_nan=False)))


def test_what_is_written_is_read_back() -> None:
    document = written()
    assert document["rmse"] is None
    assert (document["tau_s"], document["name"]) == (0.5, "own")
    assert not {"own", "rmse_um", "here"} & set(document)
    for whole in (WHOLE, replace(WHOLE, either=Part(3.0), sure=True, rmse_um=0.25)):
        again = Whole.from_dict(written(whole), "a.json")
        assert again == replace(whole, anything={"array": [0, 1]})


def test_keys_that_are_missing_or_unknown() -> None:
    document = written() | {"unknown": 1, "count": 7.0}
    for key in ("parts", "groups", "sure", "anything"):
        del document[key]
    again = Whole.from_dict(document)
    assert (again.parts, again.groups, again.sure, again.anything) == ((), (), None, {})

    strict = Documents()
    strict.strict = True
    with pytest.raises(InputError, match=r"a\.json: names is missing; expected a list"):
        strict.read_fields(Group, {}, "a.json")
    with pytest.raises(InputError, match=r"a\.json: 'x' is unknown; known are tau_s, name"):
        strict.read_fields(Part, {"tau_s": 1.0, "x": 1}, "a.json")


@over(
    "changed, said",
    [
        (
            {"parts": [{"tau_s": 1}, {"tau_s": -1}]},
            r"parts[1]: tau_s is -1.0; give a time above 0 s",
        ),
        ({"parts": [{"tau_s": 1}, {}]}, "parts[1].tau_s is missing; expected a number"),
        ({"parts": [3]}, "parts[0] is 3; expected an object"),
        ({"parts": "creep"}, "parts is 'creep'; expected a list"),
        ({"pair": [0.0]}, "pair is [0.0]; expected a list of 2"),
        ({"pair": [0.0, True]}, "pair[1] is True; expected a number"),
        ({"groups": [["x", 1]]}, "groups[0][1] is 1; expected text"),
        ({"kind": ["a"]}, "kind is ['a']; expected one of 'a', 'b'"),
        ({"colour": {}}, "colour is {}; expected one of 'red'"),
        ({"count": 7.5}, "count is 7.5; expected a whole number"),
        ({"count": 10**400}, "count is "),
        ({"sure": 1}, "sure is 1; expected True or False"),
        ({"either": 3}, "either is 3; expected an object or text"),
        ({"numbers": {"x": "1"}}, "numbers.x is '1'; expected a number"),
        ({"numbers": None}, "numbers is None; expected an object"),
        ({"rmse": 1e400}, "rmse is inf; expected a number"),
        ({"rmse": math.nan}, "rmse is nan; expected a number"),
        ({"tau_s": "1"}, "tau_s is '1'; expected a number"),
        ({"anything": [1]}, "anything is [1]; expected an object"),
    ],
)
def test_a_value_of_another_type_is_named_by_its_place(changed, said) -> None:
    with pytest.raises(InputError) as refusal:
        Whole.from_dict(written() | changed, "a.json")
    assert str(refusal.value).startswith(f"a.json: {said}")


def test_no_object_at_all_and_a_place_of_an_item() -> None:
    with pytest.raises(InputError, match=r"^a.json is \[\]; expected an object$"):
        Whole.from_dict([], "a.json")
    assert at("a.json", 2) == "a.json: [2]"


def test_an_alias_of_an_annotation_is_read_as_what_it_stands_for() -> None:
    extensions = pytest.importorskip("typing_extensions")
    number = TypeVar("number")
    many = extensions.TypeAliasType("many", tuple[number, ...], type_params=(number,))
    assert PLAIN.read(many[int], [1, 2], "document") == (1, 2)
    assert described(many[int]) == "a sequence of a whole number"
    with pytest.raises(InputError, match=r"document: \[0\] is 'one'"):
        PLAIN.read(many[int], ["one"], "document")
