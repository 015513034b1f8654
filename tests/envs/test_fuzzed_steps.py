"""Random configurations and actions: every observation lies in the space that was declared."""

from dataclasses import MISSING, dataclass, fields, replace

import gymnasium as gym
import numpy as np

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.wrappers.history import HistoryObservation, VectorHistoryObservation
from rdpi_gym.envs.wrappers.scaling import ScaledObservation, VectorScaledObservation
from rdpi_gym.plant import PLANTS, Converter, PlantModel, named_plant
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.signals import SIGNALS
from rdpi_gym.support.errors import InputError
from tests.looping import over

NAME = "rdpi_gym/PiezoTracking-v0"
SEEDS = range(4)
STEPS = 13_000  # for each seed: half in single environments, half in lanes
EPISODE, LANES = 130, 13
BASELINES = ("classical-static", "pi-classical-reference-rate", "inversion-free-low-passed")
# Signals that have a default for each of their fields.
REFERENCES = tuple(
    name
    for name, kind in SIGNALS.items()
    if all(field.default is not MISSING for field in fields(kind))
)


@dataclass(frozen=True)
class Case:
    """An environment of random keywords, with wrappers, and the actions that it gets."""

    keywords: dict
    history: int | None
    scaled: bool
    actions: str


def random_effect(kind: type[Effect], rng: np.random.Generator) -> Effect:
    """An effect whose parameters lie at their bounds, typically, or anywhere."""
    values = {}
    for p in kind.parameters:
        ends = {"low": p.low, "high": p.high, "typical": rng.uniform(*p.typical)}
        values[p.name] = float(rng.choice([*ends.values(), rng.uniform(p.low, p.high)]))
    return kind(**values)


def random_plant(rng: np.random.Generator) -> PlantModel:
    model = named_plant(str(rng.choice(PLANTS)))
    if rng.random() < 0.75:
        names = rng.permutation(list(CATALOGUE))[: rng.integers(1, 5)]
        effects = tuple(random_effect(CATALOGUE[str(name)], rng) for name in names)
        model = replace(model, effects=effects, offset_um=float(rng.uniform(-5.0, 5.0)))
    return replace(model, converter=Converter()) if rng.random() < 0.7 else model


def random_case(rng: np.random.Generator) -> Case:
    plant = random_plant(rng)
    keywords = {
        "plant": plant,
        "amplitude_um": plant.reference_um[1] * float(rng.choice([0.05, 0.5, 1.0])),
        "ts_s": float(rng.choice([1e-5, 5e-5, 1e-4, 1e-3])),
        "rate_bandwidth_hz": rng.choice([800.0, 100.0, None]),
        "reference": [str(name) for name in rng.choice(REFERENCES, rng.integers(1, 4))],
        "frequency_hz": sorted(rng.uniform(1.0, 200.0, 2).tolist()),
        "smooth_start_s": float(rng.choice([0.0, 0.01])),
        "preview": int(rng.integers(1, 13)),
        "noise_um": float(rng.choice([0.0, 0.05, 5.0])),
        "resolution_um": float(rng.choice([0.0, 0.01, 3.0])),
        "randomise": float(rng.choice([0.0, 0.2, 0.95])),
        "randomise_effects": float(rng.choice([0.0, 0.3, 0.95])),
        "command_cost": float(rng.choice([0.0, 1.0])),
        "action": str(rng.choice(["command", "increment", "correction"])),
    }
    if keywords["action"] == "correction":
        is_rdpi = plant.hysteresis.name == "rdpi"
        keywords["baseline"] = str(rng.choice(BASELINES)) if is_rdpi else "core-inverse"
    if keywords["action"] != "command":
        keywords["action_scale_V"] = float(rng.choice([0.1, 5.0, 500.0]))
    history = int(rng.integers(0, 6)) if rng.random() < 0.4 else None
    actions = str(rng.choice(["uniform", "ends", "alternating", "constant", "huge", "walk"]))
    return Case(keywords, history, bool(rng.random() < 0.4), actions)


def drawn_actions(case: Case, steps: int, lanes: int, rng: np.random.Generator) -> np.ndarray:
    shape = (steps, lanes, 1)
    values = {
        "uniform": lambda: rng.uniform(-1.0, 1.0, shape),
        "ends": lambda: rng.choice([-1.0, 0.0, 1.0], shape),
        "alternating": lambda: np.broadcast_to((-1.0) ** np.arange(steps)[:, None, None], shape),
        "constant": lambda: np.broadcast_to(rng.uniform(-1.0, 1.0, (1, lanes, 1)), shape),
        "huge": lambda: rng.choice([-3e38, -5.0, 5.0, 3e38], shape),
        "walk": lambda: np.clip(rng.normal(0.0, 0.1, shape).cumsum(axis=0), -1.0, 1.0),
    }[case.actions]()
    return values.astype(np.float32)


def beyond_what_can_be_shown(error: InputError) -> None:
    """A reference or a plant goes too far: it is refused in one line."""
    line = str(error)
    assert "what can be shown ends at" in line
    assert "\n" not in line
    assert len(line) < 400


def check(space: gym.spaces.Space, observation: np.ndarray, reward, words: str) -> None:
    assert observation.dtype == np.float32, words
    assert observation.shape == space.shape, words
    assert space.contains(observation), (words, observation)
    assert np.isfinite(observation).all(), words
    assert np.isfinite(reward).all(), words


def steps_of_single(case: Case, rng: np.random.Generator, words: str) -> int:
    env = gym.make(NAME, disable_env_checker=True, **case.keywords)
    if case.history is not None:
        env = HistoryObservation(env, case.history)
    if case.scaled:
        env = ScaledObservation(env)
    seed = int(rng.integers(2**31))
    done = 0
    try:
        options = {"plant": random_plant(rng)} if rng.random() < 0.2 else None
        observation, _ = env.reset(seed=seed, options=options)
        check(env.observation_space, observation, 0.0, words)
        for action in drawn_actions(case, EPISODE, 1, rng)[:, 0]:
            observation, reward, *_ = env.step(action)
            check(env.observation_space, observation, reward, words)
            done += 1
    except InputError as error:
        beyond_what_can_be_shown(error)
    return done


def steps_of_lanes(case: Case, rng: np.random.Generator, words: str) -> int:
    mode = str(rng.choice(["NextStep", "SameStep"]))
    envs = PiezoTrackingVectorEnv(LANES, max_episode_steps=7, autoreset_mode=mode, **case.keywords)
    if case.history is not None:
        envs = VectorHistoryObservation(envs, case.history)
    if case.scaled:
        envs = VectorScaledObservation(envs)
    seed = int(rng.integers(2**31))
    done = 0
    try:
        observation, _ = envs.reset(seed=seed)
        check(envs.observation_space, observation, 0.0, words)
        for action in drawn_actions(case, EPISODE // LANES, LANES, rng):
            observation, reward, _, _, info = envs.step(action)
            check(envs.observation_space, observation, reward, words)
            for last in info.get("final_obs", ()):
                if last is not None:
                    check(envs.single_observation_space, last, 0.0, words)
            done += LANES
    except InputError as error:
        beyond_what_can_be_shown(error)
    return done


@over("seed", SEEDS)
def test_every_observation_of_random_environments_lies_in_its_space(seed):
    rng = np.random.default_rng(seed)
    done = made = 0
    while done < STEPS:
        case = random_case(rng)
        words = f"seed {seed}, case {made}: {case}"
        done += steps_of_single(case, rng, words) + steps_of_lanes(case, rng, words)
        made += 1
    print(f"seed {seed}: {done} steps of {made} environments and as many vectors of {LANES} lanes")
    assert made < 1.2 * STEPS / (2 * EPISODE)  # few references go beyond what can be shown
