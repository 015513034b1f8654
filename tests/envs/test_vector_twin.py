"""Lane by lane, step by step, the vector environment is the single one, to rounding."""

import functools
import warnings
from dataclasses import dataclass, replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numba import njit

import rdpi_gym  # noqa: F401  # registers the environments
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.vector.chain import stage_address
from rdpi_gym.plant import CORES, named_plant
from rdpi_gym.plant.effects import CATALOGUE, Effect, Parameter, forms_of, load_effect
from rdpi_gym.plant.effects.base import SLOTS
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.errors import InputError
from tests.looping import over

NAME = "rdpi_gym/PiezoTracking-v0"
# Of the largest displacement; the vector units add the plays up in another order.
ROUNDING = 1e-12
EVERY_EFFECT = replace(
    named_plant("P10"), effects=tuple(kind() for kind in CATALOGUE.values()), offset_um=3.0
)


CORRECTION = {"action": "correction"}


def with_forms(number):
    """The plant with that further form of every effect that has as many; the last where it has not."""
    kinds = [forms_of(kind) for kind in CATALOGUE.values()]
    effects = tuple(forms[min(number, len(forms) - 1)]() for forms in kinds)
    return replace(EVERY_EFFECT, effects=effects)


SCALE = DataScale(
    centre_V=0.0, span_V=30.0, stroke_um=20.0, fastest_V_s=400.0, shortest_s=1e-4, longest_s=4.0
)


def with_core(name):
    """The plant of every effect around that core, at numbers that a fit of it begins with."""
    core = CORES[name].starts(SCALE)[-1]
    return replace(EVERY_EFFECT, hysteresis=core, name=name, command_range_V=(-30.0, 30.0))


MOST_FORMS = max(len(forms_of(kind)) for kind in CATALOGUE.values())


def difference(ours, theirs, lane):
    """Return the largest difference of one lane's numbers: observation, reward, info."""
    observation, reward, info = ours
    one, its_reward, its_info = theirs
    assert {key for key in info if not key.startswith("_")} >= set(its_info)
    numbers = [abs(info[key][lane] - value) for key, value in its_info.items()]
    # Observations are float32: a number of a few units, as the plant of every effect shows.
    shown = np.abs(observation[lane].astype(float) - one).max() - 4e-7 * np.abs(one).max()
    return max(*numbers, abs(reward[lane] - its_reward), shown)


def largest_difference(lanes, steps, episode, seed=7, **keywords):
    """Step lanes and single environments side by side, over autoresets; return what differs."""
    envs = PiezoTrackingVectorEnv(
        lanes, max_episode_steps=episode, autoreset_mode="SameStep", **keywords
    )
    unlimited = -1  # as gymnasium.make says None
    limit = unlimited if episode is None else episode
    singles = [gym.make(NAME, max_episode_steps=limit, **keywords) for _ in range(lanes)]
    observation, info = envs.reset(seed=seed)
    zeros, worst = np.zeros(lanes), 0.0
    for lane, env in enumerate(singles):
        one, its_info = env.reset(seed=seed + lane)
        worst = max(worst, difference((observation, zeros, info), (one, 0.0, its_info), lane))
    actions = np.random.default_rng(0).uniform(-1.1, 1.1, (steps, lanes, 1)).astype(np.float32)
    for action in actions:
        observation, reward, terminated, truncated, info = envs.step(action)
        for lane, env in enumerate(singles):
            one, its_reward, *over, its_info = env.step(action[lane])
            assert [terminated[lane], truncated[lane]] == over
            if truncated[lane]:
                final = (info["final_obs"], reward, info["final_info"])
                worst = max(worst, difference(final, (one, its_reward, its_info), lane))
                one, its_info = env.reset()
            numbers = (observation, reward, info), (one, its_reward, its_info)
            worst = max(worst, difference(*numbers, lane))
    return worst


@over("name", ["Load", "Ageing", "Measured"])
def test_privileged_values_of_lanes_are_those_of_single_environments(name):
    """Plants that change within an episode, that were worn before it, and of six kinds; over a reset."""
    task = {"id": f"rdpi_gym/Piezo{name}-v0", "privileged": True, "max_episode_steps": 60}
    envs = gym.make_vec(num_envs=3, autoreset_mode="SameStep", **task)
    singles = [gym.make(**task) for _ in range(3)]
    found = [envs.reset(seed=3)[1]["privileged"]]
    expected = [[env.reset(seed=3 + lane)[1]["privileged"] for lane, env in enumerate(singles)]]
    for _ in range(90):
        found.append(envs.step(np.zeros((3, 1), np.float32))[4]["privileged"])
        now = []
        for env in singles:
            _, _, _, over_now, info = env.step(np.zeros(1, np.float32))
            now.append((env.reset()[1] if over_now else info)["privileged"])
        expected.append(now)
    assert len(singles[0].unwrapped.latents) == np.shape(found)[-1]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert np.ptp(found, axis=0).any()


def test_lanes_that_are_given_other_references_on_the_way():
    """Kernels that had sines alone take up multisines of more lines, and a signal that Python samples."""
    envs = PiezoTrackingVectorEnv(3, plant="P5", max_episode_steps=None, noise_um=0.01)
    singles = [gym.make(NAME, plant="P5", noise_um=0.01, max_episode_steps=-1) for _ in range(3)]
    envs.reset(seed=5)
    for lane, env in enumerate(singles):
        env.reset(seed=5 + lane)
    given = {
        1: {"signal": "multisine", "lines": 20, "frequency_hz": 5.0, "seed": 4},
        2: {"signal": "sawtooth", "flyback_fraction": 0.2},
        0: {"signal": "triangle", "phase_rad": 1.0},
    }
    actions = iter(np.random.default_rng(0).uniform(-1.0, 1.0, (150, 3, 1)).astype(np.float32))
    for lane, reference in given.items():
        mask = np.arange(3) == lane
        observation, info = envs.reset(options={"reset_mask": mask, "reference": reference})
        found = singles[lane].reset(options={"reference": reference})
        ours = observation, np.zeros(3), info
        assert difference(ours, (found[0], 0.0, found[1]), lane) < 25.0 * ROUNDING
        for _ in range(50):
            action = next(actions)
            observation, reward, _, _, info = envs.step(action)
            for each, env in enumerate(singles):
                one, its_reward, _, _, its_info = env.step(action[each])
                ours = observation, reward, info
                assert difference(ours, (one, its_reward, its_info), each) < 25.0 * ROUNDING


@njit
def wobble_block(x, u, p, state, ts, y):
    """Kernel of an effect that the catalogue does not have."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            if np.isnan(state[0, b]):
                state[0, b] = 0.0
            y[t, b] = x[t, b] + p[0, b] * np.sin(0.1 * state[0, b]) * u[t, b]
            state[0, b] += 1.0


@dataclass(frozen=True)
class Wobble(Effect):
    """A user's own effect."""

    gain: float = 0.1

    name = "wobble"
    slot = "output"
    order = 5
    parameters = (Parameter("gain", "µm/V", 0.0, 1.0, (0.1, 0.1), "gain"),)
    equation = source = signature = experiment = "a test"
    mistaken_for = ()
    block = staticmethod(wobble_block)

    def coefficients(self, ts_s, hysteresis):
        """Gain over a_0."""
        return [self.gain / hysteresis.a0]

    def state_rows(self, ts_s):
        """The clock."""
        return 1


P5, P10 = named_plant("P5"), named_plant("P10")
SMALL = {"lanes": 3, "steps": 60, "episode": 25, "randomise": 0.1, "randomise_effects": 0.3}
ALONE = {"lanes": 2, "steps": 120, "episode": 50, "randomise": 0.1, "randomise_effects": 0.2}
OPTIONS = {"lanes": 4, "steps": 130, "episode": 45}
LONG = {
    "lanes": 2, "steps": 4300, "episode": None, "plant": "P5", "noise_um": 0.1,
    "frequency_hz": (3.0, 30.0), "seed": 3,
}  # fmt: skip
EVERY = {
    "lanes": 5, "steps": 130, "episode": 40, "plant": EVERY_EFFECT, "randomise": 0.2,
    "randomise_effects": 0.4, "noise_um": 0.05, "command_cost": 0.5,
    "reference": ["sine", "triangle", {"signal": "multisine", "lines": 4}],
}  # fmt: skip
SINES = [
    {"signal": "sine", "frequency_hz": 77.0, "phase_rad": 1.0, "smooth_start_s": 4e-3},
    {"signal": "sine", "amplitude_um": 3.0},
    {"signal": "random-steps"},
]
CASES = [  # bound in units of the rounding, and what is run
    *((100.0, EVERY | {"action": action}) for action in ("command", "increment")),
    *(
        (25.0, ALONE | {"plant": replace(P5, effects=(CATALOGUE[name](),))})
        for name in (*CATALOGUE, "unknown")
    ),
    (100.0, OPTIONS),
    # a converter that holds
    (100.0, OPTIONS | {"plant": "P10-bench", "ts_s": 1e-5, "randomise": 0.3}),
    (100.0, OPTIONS | {"plant": "P5-static", "preview": 1, "rate_bandwidth_hz": None}),
    (100.0, OPTIONS | {"plant": "picma", "resolution_um": 0.02}),
    (100.0, OPTIONS | CORRECTION | {"baseline": "pi-classical-low-passed", "noise_um": 0.01}),
    (100.0, OPTIONS | CORRECTION | {"baseline": "extended-inverse", "belief": "P10-static"}),
    (
        100.0,
        OPTIONS
        | {"amplitude_um": 20.0, "offset_um": -5.0, "smooth_start_s": 0.0, "frequency_hz": 50.0},
    ),
    (100.0, OPTIONS | {"reference": SINES}),
    # a baseline that plans ahead
    (
        25.0,
        {"lanes": 2, "steps": 25, "episode": 10, "plant": "P5", "frequency_hz": 100.0}
        | CORRECTION
        | {"baseline": "preview-inversion"},
    ),
    # episodes longer than the samples that are made at a time
    (25.0, LONG | {"reference": ["sine", "triangle"]}),
    (25.0, LONG | {"reference": ["sawtooth"]}),
    (25.0, LONG | {"reference": [{"signal": "multisine", "lines": 3, "odd": True}]}),
    *((80.0, {"lanes": n, "steps": 6, "episode": 4, "randomise": 0.2}) for n in (33, 500)),
    (100.0, SMALL | {"plant": replace(EVERY_EFFECT, effects=(*EVERY_EFFECT.effects, Wobble()))}),
    *((100.0, SMALL | {"plant": with_forms(number)}) for number in range(1, MOST_FORMS)),
    *(
        (
            100.0,
            SMALL
            | {"plant": replace(with_core(name), effects=effects)}
            | {"randomise": 0.2, "noise_um": 0.05},
        )
        for name in CORES
        for effects in ((), EVERY_EFFECT.effects)
    ),
    # a past about the start is about the command at rest
    *(
        (
            100.0,
            SMALL
            | {"randomise": 0.0}
            | {"plant": replace(P10, command_range_V=(15.0, 60.0), effects=(past(),))},
        )
        for past in (load_effect("initial_memory", w) for w in ("about the start", "last turns"))
    ),
]


def test_the_effects_have_every_slot():
    assert {effect.slot for effect in EVERY_EFFECT.effects} == set(SLOTS)


@over("bound, case", CASES)
def test_every_lane_is_the_single_environment(bound, case):
    assert largest_difference(**case) < bound * ROUNDING


def test_a_kernel_that_does_not_compile_is_refused_in_one_line():
    class Fickle(Wobble):
        name = "fickle"
        block = staticmethod(lambda x, u, p, state, ts, y: state.sort_of(u))

    with pytest.raises(InputError, match="the kernel of fickle cannot be compiled: ") as refusal:
        PiezoTrackingVectorEnv(2, plant=replace(named_plant("P10"), effects=(Fickle(),)))
    assert "\n" not in str(refusal.value)


def test_a_kernel_that_is_no_function_or_returns_a_value_is_refused_in_one_line(monkeypatch):
    @njit
    def returning(x, u, p, state, ts, y):
        return y

    rows = np.zeros((1, 1))
    returning(rows, rows, rows, rows, 1.0, rows)  # compiled, before anyone asks what it returns
    blocks = (functools.partial(wobble_block.py_func, ts=1.0), returning)
    # releases of numba that ask for the arguments alone leave the value to us
    reasons = ("cannot be compiled: ", "cannot be compiled: |returns array")
    for block, reason in zip(blocks, reasons, strict=True):
        with pytest.raises(InputError, match=f"^the kernel of own ({reason})") as refusal:
            stage_address(block, "own")
        assert "\n" not in str(refusal.value)
    monkeypatch.setattr(
        type(returning), "get_compile_result", lambda own, wanted: own.overloads[wanted.args]
    )
    with pytest.raises(InputError, match=r"^the kernel of own returns array.*return nothing$"):
        stage_address(returning, "own")


def test_a_kernel_declared_for_strided_arrays_runs_as_one_declared_for_none():
    rows = "f8[:,:]"

    class Strided(Wobble):
        name = "strided"
        block = staticmethod(
            njit(f"void({rows},{rows},{rows},{rows},f8,{rows})")(wobble_block.py_func)
        )

    for own in (Wobble(), Strided()):
        environment = PiezoTrackingVectorEnv(2, plant=replace(named_plant("P10"), effects=(own,)))
        environment.reset(seed=1)
        then = environment.step(np.full((2, 1), 0.3, dtype=np.float32))[0].copy()
        if own.name == "wobble":
            expected = then
    assert np.isfinite(then).all()
    np.testing.assert_array_equal(then, expected)


@over("name", list(CORES))
def test_numbers_of_a_core_are_drawn_within_their_bounds(name):
    env = gym.make(NAME, plant=with_core(name), randomise=0.3).unwrapped
    nominal, gains, shapes = env.nominal.hysteresis, [], []
    for _ in range(12):
        env.reset(seed=None if gains else 0)
        core = env.truth.hysteresis
        gains.append(core.gains)
        shapes.append([getattr(core, p.name) for p in core.shape])
        assert np.all(np.diff(getattr(core, "thresholds_V", ())) > 0)
        for p, value in zip(core.shape, shapes[-1], strict=True):
            assert p.low <= value <= p.high
    size = np.abs(nominal.gains) + 1e-12
    assert np.all(np.abs(np.array(gains) - nominal.gains) <= 0.3 * size * (1.0 + 1e-9))
    assert len({gain[-1] for gain in gains}) == 12
    for p, values in zip(nominal.shape, np.array(shapes).T, strict=True):
        assert len(set(values.tolist())) > 3 or getattr(nominal, p.name) == 0.0


@over("name", list(CORES))
def test_checkers_have_no_complaint_of_a_core(name):
    plant = replace(with_core(name), effects=()).to_dict()  # as a file holds it
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(NAME, plant=plant).unwrapped, skip_render_check=True)
    envs = gym.make_vec(
        NAME, num_envs=3, vectorization_mode="vector_entry_point", plant=plant, randomise=0.1
    )
    observation, _ = envs.reset(seed=0)
    for _ in range(3):
        assert observation in envs.observation_space
        observation, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
        assert (reward.dtype, terminated.dtype, truncated.dtype) == (np.float64, bool, bool)
        assert all(len(values) == 3 for values in info.values())


def test_a_plant_with_another_core_is_refused():
    env = PiezoTrackingVectorEnv(2, plant=with_core("stop"))
    with pytest.raises(
        InputError, match=r"duhem has the core duhem, and the lanes of .* have stop;"
    ):
        env.reset(options={"plant": with_core("duhem")})


def test_effects_are_drawn_at_levels_of_their_range():
    plant = replace(named_plant("P5"), effects=(CATALOGUE["creep"](gain_per_decade=0.02),))
    env = gym.make(NAME, plant=plant, randomise_effects=0.5).unwrapped
    drawn = []
    for episode in range(300):
        env.reset(seed=0 if episode == 0 else None)
        drawn.append(env.truth.effects[0].values["gain_per_decade"])
        assert env.truth.hysteresis == env.nominal.hysteresis
        assert env.belief.effects == ()
    levels = 0.02 * (1.0 + 0.5 * np.linspace(-1.0, 1.0, 33))
    nearest = np.abs(np.array(drawn)[:, None] - levels).argmin(axis=1)
    np.testing.assert_allclose(drawn, levels[nearest], rtol=1e-12)
    # 300 draws of 33 levels leave each of them out with a chance of 1e-4.
    assert len(set(nearest.tolist())) >= 32


def test_a_plant_with_another_form_of_an_effect_is_refused():
    lags = [replace(named_plant("P5"), effects=(k(),)) for k in forms_of(CATALOGUE["sensor_lag"])]
    env = PiezoTrackingVectorEnv(2, plant=lags[0])
    with pytest.raises(
        InputError, match=r"P5 has sensor_lag, second order, and .* have sensor_lag;"
    ):
        env.reset(options={"plant": lags[1]})
