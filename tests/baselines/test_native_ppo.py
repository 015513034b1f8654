"""PPO of our own: what Stable-Baselines3 computes on the same rollout, and exact continuation."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from baselines.learned.native_learner import Lanes, NativeLearner
from baselines.learned.native_ppo import (
    ActorCritic,
    Batch,
    NativePPO,
    Updater,
    Workspace,
    estimate_advantages,
)
from baselines.learned.options import PLANTS, Run, TrainingOptions
from baselines.learned.settings import Settings
from baselines.learned.training import NativeOptions
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.wrappers.history import VectorHistoryObservation
from rdpi_gym.envs.wrappers.scaling import VectorScaledObservation

STEPS, LANES, INPUTS, HIDDEN = 24, 5, 7, (16, 12)
YAML = """
default:
  n_envs: 5
  n_timesteps: 400
  n_steps: 16
  batch_size: 33
  n_epochs: 2
  learning_rate: lin_1e-3
  net_arch: [8]
  env_wrapper:
    - rdpi_gym.envs.wrappers.history.HistoryObservation: {history: 2}
"""


def options(tmp_path, folder="run", more="", **fields):
    path = tmp_path / "native.yml"
    path.write_text(YAML + more)
    given = {"out": tmp_path / folder, "hyperparameters": path, "action": "increment"}
    return NativeOptions(**(given | fields))


def learner(tmp_path, more=""):
    return NativeLearner(Run.open(options(tmp_path, more=more), "native-ppo", NativePPO))


def reference_model(**arguments):
    """Stable-Baselines3's PPO without an environment that is ever stepped."""
    sb3 = pytest.importorskip("stable_baselines3")
    import gymnasium as gym
    from stable_baselines3.common.logger import Logger

    class Idle(gym.Env):
        observation_space = gym.spaces.Box(-9.0, 9.0, (INPUTS,), np.float32)
        action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)

        def reset(self, *, seed=None, options=None):
            return np.zeros(INPUTS, np.float32), {}

    model = sb3.PPO(
        "MlpPolicy", sb3.common.vec_env.DummyVecEnv([Idle] * LANES), n_steps=STEPS, device="cpu", seed=0,
        policy_kwargs={"net_arch": list(HIDDEN), "log_std_init": -1.0}, **arguments,
    )  # fmt: skip
    model.set_logger(Logger(None, []))
    return model


def linear_layers(model):
    """The pairs of linear layers of actor and critic, from the input on."""
    hidden = [
        [m for m in net if isinstance(m, torch.nn.Linear)]
        for net in (model.policy.mlp_extractor.policy_net, model.policy.mlp_extractor.value_net)
    ]
    heads = (model.policy.action_net, model.policy.value_net)
    return list(
        zip(*([*nets, head] for nets, head in zip(hidden, heads, strict=True)), strict=True)
    )


@pytest.mark.parametrize(
    ("numbers", "ends_early"),
    [
        ({"batch_size": 60, "n_epochs": 3, "clip_range": 0.1, "ent_coef": 0.01, "vf_coef": 0.7,
          "max_grad_norm": 0.4}, False),
        ({"batch_size": 40, "n_epochs": 4, "target_kl": 0.005, "max_grad_norm": 9.0}, True),
    ],
)  # fmt: skip
def test_an_update_is_that_of_stable_baselines(numbers, ends_early):
    ppo = NativePPO(**numbers)
    model = reference_model(learning_rate=3e-3, **numbers)
    both = ActorCritic((INPUTS, *HIDDEN, 1), -1.0, seed=0)
    for layers, weight, bias in zip(linear_layers(model), both.weights, both.biases, strict=True):
        for net, layer in enumerate(layers):
            weight[net], bias[net, 0] = layer.weight.data.T, layer.bias.data
    rng, buffer = np.random.default_rng(3), model.rollout_buffer
    for name in ("observations", "actions", "advantages", "returns", "values"):
        array = getattr(buffer, name)
        array[:] = rng.normal(size=array.shape).astype(np.float32)
    with torch.no_grad():
        flat = (torch.as_tensor(x).flatten(0, 1) for x in (buffer.observations, buffer.actions))
        densities = model.policy.evaluate_actions(*flat)[1]
    buffer.log_probs[:] = densities.reshape(STEPS, LANES).numpy() + 0.05 * rng.normal(
        size=(STEPS, LANES)
    )
    buffer.full = True

    # As its buffer does: lane by lane, each minibatch a slice of a permutation.
    batch = Batch(
        *(
            torch.as_tensor(np.ascontiguousarray(x.swapaxes(0, 1))).reshape(STEPS * LANES, -1)
            for x in (buffer.observations, buffer.actions, buffer.log_probs, buffer.advantages, buffer.returns)
        )
    )  # fmt: skip
    batch = Batch(batch.rows, *(x.flatten() for x in batch[1:]))
    state = np.random.RandomState(7)  # its permutations are drawn by the old generator
    orders = [torch.as_tensor(state.permutation(STEPS * LANES)) for _ in range(ppo.n_epochs)]
    np.random.seed(7)  # noqa: NPY002
    model.train()
    _, steps = Updater(both, threads=2).update(batch, ppo, 3e-3, ppo.clip_range, orders)

    assert (steps < ppo.n_epochs * STEPS * LANES // ppo.batch_size) == ends_early
    for layers, weight, bias in zip(linear_layers(model), both.weights, both.biases, strict=True):
        for net, layer in enumerate(layers):
            torch.testing.assert_close(weight[net].T, layer.weight.data, rtol=1e-4, atol=2e-6)
            torch.testing.assert_close(bias[net, 0], layer.bias.data, rtol=1e-4, atol=2e-6)
    torch.testing.assert_close(both.log_std, model.policy.log_std.data[0], rtol=1e-5, atol=1e-6)


def test_advantages_are_those_of_stable_baselines():
    buffer = reference_model(gamma=0.9, gae_lambda=0.8, batch_size=STEPS).rollout_buffer
    rng = np.random.default_rng(0)
    rewards, values = (rng.normal(size=(STEPS, LANES)).astype(np.float32) for _ in range(2))
    nexts = rng.normal(size=(STEPS, LANES)).astype(np.float32)
    ends = rng.random((STEPS, LANES)) < 0.2
    ends[-1] = False
    nexts[:-1] = np.where(ends[:-1], nexts[:-1], values[1:])
    # Its algorithms add what a truncated episode would have earned to the last reward.
    buffer.rewards[:], buffer.values[:] = rewards + 0.9 * nexts * ends, values
    buffer.episode_starts[1:] = ends[:-1]
    buffer.compute_returns_and_advantage(torch.as_tensor(nexts[-1]), np.zeros(LANES))
    arrays = (rewards, values, nexts, 1.0 - ends.astype(np.float32))
    found = estimate_advantages(*map(torch.as_tensor, arrays), 0.9, 0.8)
    np.testing.assert_allclose(found.numpy(), buffer.advantages, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("history", [0, 3])
def test_rows_are_what_the_wrappers_show(history):
    asked = TrainingOptions(Path("unused"), action="increment", plants=PLANTS[2:], preview=2)
    settings = Settings(5, 10, history, frequency_hz=40.0, error=0.1)
    lanes = Lanes(asked, settings, 5, parts=2)
    rows = np.zeros((2, 5, lanes.scaling.history.size), np.float32)
    lanes.begin(11, rows[0])
    groups = [
        VectorScaledObservation(
            VectorHistoryObservation(
                PiezoTrackingVectorEnv(count, plant=plant, **asked.environment()), history
            ),
            40.0, 0.1,
        )
        for count, plant in zip((3, 2), asked.plants, strict=True)
    ]  # fmt: skip
    wrapped = [g.reset(seed=seed)[0] for g, seed in zip(groups, (11, 14), strict=True)]
    np.testing.assert_array_equal(rows[0], np.concatenate(wrapped))
    rng, rewards = np.random.default_rng(0), np.empty(5, np.float32)
    for _ in range(6):
        actions = rng.uniform(-1.0, 1.0, 5).astype(np.float32)
        for part in lanes.parts:
            own = slice(part.first, part.end)
            part.step(actions[own].astype(float), rows[0, own], rows[1, own], rewards[own])
        found = [
            g.step(some[:, None]) for g, some in zip(groups, np.split(actions, [3]), strict=True)
        ]
        np.testing.assert_allclose(rows[1], np.concatenate([f[0] for f in found]), atol=3e-5)
        expected = np.concatenate([f[1] for f in found]).astype(np.float32)
        np.testing.assert_array_equal(rewards, expected)
        rows = rows[::-1]


def test_every_lane_begins_anew_after_as_many_samples_as_an_episode_has_and_not_all_at_once():
    asked = TrainingOptions(Path("unused"), plants=PLANTS[3:], episode=25, action="increment")
    (part,) = Lanes(asked, Settings(23, 10), 23, parts=1).parts
    ends = np.zeros((100, 23), dtype=bool)
    for k in range(100):
        part.steps = k + 1
        ends[k, part.ended()] = True
    assert all(set(np.diff(np.flatnonzero(lane))) == {25} for lane in ends.T)
    assert ends.sum(axis=1).max() == 3


def test_the_critic_goes_on_saying_what_it_said_as_its_units_move(tmp_path):
    one = learner(tmp_path)
    rows = torch.randn(9, one.both.widths[0])

    def said():
        mean, scale = one._scale()
        return mean + scale * one._values(rows)

    one._follow(torch.linspace(-3.0, -1.0, 50))
    before = said()
    one._follow(torch.linspace(-30.0, 4.0, 50))
    torch.testing.assert_close(said(), before, rtol=1e-4, atol=1e-4)


def test_the_learning_rate_follows_how_far_updates_lead(tmp_path):
    one = learner(tmp_path, more="  target_kl: 0.01\n")
    for divergence, share in (
        (0.02, 1 / 1.5),
        (0.012, 1 / 1.5),
        (0.02, 1 / 2.25),
        (0.001, 1 / 1.5),
    ):
        one._adapt(divergence)
        assert one._share == pytest.approx(share)
    for _ in range(3):
        one._adapt(0.0)
    assert one._share == 1.0


def test_the_policy_acts_as_the_networks_mean_does(tmp_path):
    one = learner(tmp_path)
    rows = 9.0 * torch.randn(20, one.both.widths[0])
    mean = one.both.forward(rows, Workspace(one.both.widths))[0]
    action = torch.nn.Sequential(*one.actor())(rows)
    torch.testing.assert_close(action, mean.clamp(-1.0, 1.0), rtol=1e-5, atol=1e-6)
