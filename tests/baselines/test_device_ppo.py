"""PPO on a torch device: the native learner's update and lanes, and functions that can be captured."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from baselines.learned import evaluation, train_native_ppo
from baselines.learned.controller import LearnedController
from baselines.learned.device import lanes as device_lanes
from baselines.learned.device import replay as replays
from baselines.learned.device.lanes import Rows
from baselines.learned.device.learner import DeviceActorCritic, DeviceLearner, DeviceUpdater
from baselines.learned.native.networks import ActorCritic
from baselines.learned.native.ppo import NativePPO
from baselines.learned.native.update import Batch, Law, Updater
from baselines.learned.policy import Policy
from baselines.learned.run import Run
from rdpi_gym.cli import main
from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
from rdpi_gym.envs.wrappers.history import VectorHistoryObservation
from rdpi_gym.envs.wrappers.scaling import VectorScaledObservation
from rdpi_gym.plant import Sensor, named_plant
from rdpi_gym.support.errors import InputError

BARE = replace(named_plant("P10"), sensor=Sensor())
YAML = """
default:
  n_envs: 13
  n_timesteps: 600
  n_steps: 16
  batch_size: 60
  n_epochs: 2
  learning_rate: lin_1e-3
  net_arch: [8]
  target_kl: 0.01
  env_wrapper:
    - rdpi_gym.envs.wrappers.history.HistoryObservation: {history: 2}
"""
needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device is there")


@pytest.fixture(autouse=True)
def _few(monkeypatch):
    for name, value in {"LANES": 4, "SAMPLES": 30, "FIRST": 5}.items():
        monkeypatch.setattr(evaluation, name, value)
    monkeypatch.setattr(device_lanes, "DRAWN", 8)


def options(tmp_path, folder="run", more="", **fields):
    path = tmp_path / "device.yml"
    path.write_text(YAML + more)
    given = {"out": tmp_path / folder, "hyperparameters": path, "every": 220, "episode": 25}
    return train_native_ppo.Options(**(given | {"action": "increment", "device": "cpu"} | fields))


def learner(tmp_path, device="cpu", **fields):
    asked = options(tmp_path, device=device, **fields)
    return DeviceLearner(Run.open(asked, "native-ppo", NativePPO), device)


@pytest.mark.parametrize("history", [0, 1, 3])
def test_rows_are_what_the_wrappers_show(history):
    envs = VectorScaledObservation(
        VectorHistoryObservation(
            PiezoTrackingVectorEnv(3, plant=BARE, action="increment", preview=2), history
        ),
        40.0, 0.1,
    )  # fmt: skip
    rows = Rows(envs.scaling)
    plain = PiezoTrackingVectorEnv(3, plant=BARE, action="increment", preview=2)
    wrapped, _ = envs.reset(seed=4)
    ours = rows.first(torch.from_numpy(plain.reset(seed=4)[0]))
    np.testing.assert_allclose(ours.numpy(), wrapped, atol=3e-5)
    rng = np.random.default_rng(0)
    for _ in range(6):
        actions = rng.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        ours = rows.next(ours, torch.from_numpy(plain.step(actions)[0]))
        # Differences of float32 numbers, over the change of one sample: 1e-7 becomes 1e-5.
        np.testing.assert_allclose(ours.numpy(), envs.step(actions)[0], atol=3e-5)


@pytest.mark.parametrize(
    ("law", "ends_early"),
    [
        (Law(50, 3, clip_range=0.1, ent_coef=0.01, vf_coef=0.7, max_grad_norm=0.4), False),
        (Law(40, 4, target_kl=0.004, max_grad_norm=9.0), True),
    ],
)
def test_an_update_is_that_of_the_native_learner(law, ends_early):
    widths, count = (7, 16, 12, 1), 120
    both = [ActorCritic(widths, -1.0, seed=0), DeviceActorCritic(widths, -1.0, 0, "cpu")]
    updaters = [Updater(both[0]), DeviceUpdater(both[1])]
    generator = torch.Generator().manual_seed(1)
    ended = []
    for number in range(3):  # Adam's moments, and the numbers of a law, come into the next
        noise = torch.randn(count, generator=generator)
        rows = torch.randn(count, 7, generator=generator)
        more = [torch.randn(count, generator=generator) for _ in range(2)]
        densities = -0.5 * noise**2 - (-1.0 + 0.919)
        batch = Batch(rows, np.exp(-1.0) * noise, densities, *more)
        orders = [torch.randperm(count, generator=generator) for _ in range(law.n_epochs)]
        now = replace(law, clip_range=law.clip_range / (number + 1))
        native, ours = (u.update(batch, now, 3e-3 / (number + 1), orders) for u in updaters)
        ended.append(native.steps < law.n_epochs * -(-count // law.batch_size))
        assert ours.steps == native.steps
        # Sums of float32 numbers in another order.
        assert ours == pytest.approx(native, rel=2e-4, abs=1e-6)
        torch.testing.assert_close(both[1].parameters, both[0].parameters, rtol=1e-4, atol=2e-6)
    assert any(ended) == ends_early


def test_a_rollout_holds_the_episodes_of_every_lane(tmp_path):
    one = learner(tmp_path, more="  n_steps: 60\n")
    one.begin(3)
    batch, rewards = one.rollout()
    rows = batch.rows.view(60, 13, -1)
    assert torch.isfinite(rows).all()
    assert float(rewards.max()) < 0.0
    preview = one.layout.preview
    for lane in range(13):
        (ends,) = np.nonzero(one._goes_on[:, lane].numpy() == 0.0)
        assert set(np.diff(ends)) <= {25}
        # Behind the end the reference begins at the centre, and nothing has moved before.
        for k in ends[ends < 59]:
            assert rows[k + 1, lane, 0] == pytest.approx(0.0, abs=1e-6)
            assert not rows[k + 1, lane, preview + 1 : preview + 3].any()
            assert rows[k, lane, 1 : preview + 1].any()
    mean = one.both.forward(batch.rows, one._work)[0, :, 0]
    density = torch.distributions.Normal(mean, one.both.log_std.exp()).log_prob(batch.actions)
    torch.testing.assert_close(batch.densities, density, rtol=1e-4, atol=1e-5)


def test_advantages_end_with_the_episode_and_see_its_last_observation(tmp_path):
    one = learner(tmp_path, more="  n_steps: 30\n  normalise_returns: false\n")
    one.begin(3)
    batch, rewards = one.rollout()
    lane, k = 0, 24  # the first lanes end with the samples of an episode
    assert one._goes_on[k, lane] == 0.0
    surprise = rewards[k, lane] + one._gamma * one._nexts[k, lane] - one._values[k, lane]
    assert float(batch.advantages.view(30, 13)[k, lane]) == pytest.approx(float(surprise), rel=1e-5)
    assert float(one._nexts[k, lane]) != pytest.approx(float(one._values[k + 1, lane]), rel=1e-3)


def test_what_is_replayed_looks_at_no_value(tmp_path):
    """Tensors of the device `meta` have none: to fetch one, or to branch on it, would raise."""
    one = learner(tmp_path, device="meta")
    one.step()
    rows = torch.zeros(40, one.both.widths[0], device="meta")
    batch = Batch(rows, *(torch.zeros(40, device="meta") for _ in range(4)))
    one._updater.take(batch, Law(20, 1), 1e-3)
    one._updater.minibatch(torch.zeros(20, dtype=torch.int64, device="meta"))
    with pytest.raises(RuntimeError):
        one._updater.update(batch, Law(20, 1), 1e-3, [])  # which does look, at its end


def held(one):
    """Every tensor that one step or minibatch leaves something in for the next."""
    groups = [group for group, _ in one._lanes._groups]
    kept = [one._rows, one._actions, one._rewards, one._values, one._k, one._lanes.rows]
    for group in groups:
        kept += [*group.plant._columns(), group._k, group._reference, group.command_V]
    updater = one._updater
    kept += [one.both.parameters, updater._gradient, *updater._moments, updater._age]
    return [*kept, updater._goes_on, updater._sums, updater._last]


def test_what_is_replayed_moves_no_memory(tmp_path):
    one = learner(tmp_path)
    one.begin(0)
    before = [tensor.data_ptr() for tensor in held(one)]
    for _ in range(2):
        batch, _ = one.rollout()
        one._updater.update(batch, Law(60, 1), 1e-3, [torch.arange(len(batch.rows))])
    assert [tensor.data_ptr() for tensor in held(one)] == before


def test_what_is_replayed_draws_nothing(tmp_path):
    one = learner(tmp_path)
    one.begin(0)
    before = torch.get_rng_state(), one._generator.get_state()
    one.step()
    assert torch.equal(torch.get_rng_state(), before[0])
    assert torch.equal(one._generator.get_state(), before[1])


def test_a_graph_is_captured_once_and_every_call_counts(monkeypatch):
    """Torch's graphs stood in for: what is recorded does not run, and a replay runs it."""
    recording, ran = [], []

    class Graph:
        def replay(self):
            ran.append("replayed")

    class Context:
        def __init__(self, *_):
            pass

        def __enter__(self):
            recording.append(True)

        def __exit__(self, *_):
            recording.pop()

    class Quiet(Context):
        def __enter__(self):
            pass

        def __exit__(self, *_):
            pass

        def wait_stream(self, _):
            pass

    cuda = replays.torch.cuda
    for name, fake in {
        "CUDAGraph": Graph, "graph": Context, "device": Quiet, "stream": Quiet, "Stream": Quiet,
        "current_stream": Quiet,
    }.items():  # fmt: skip
        monkeypatch.setattr(cuda, name, fake)
    captured = []
    call = replays.Replay(
        lambda: captured.append(1) if recording else ran.append("called"), torch.device("cuda")
    )
    for _ in range(6):
        call()
    assert ran == ["called"] * 3 + ["replayed"] * 3
    assert len(captured) == 1


@needs_cuda
def test_replayed_graphs_train_as_plain_calls_do(tmp_path):
    found = []
    for plain in (False, True):
        one = learner(tmp_path, device="cuda")
        if plain:
            one._replay = one.step
        one.begin(5)
        for _ in range(4):
            batch, _ = one.rollout()
            orders = [torch.arange(len(batch.rows), device="cuda")]
            one._updater.update(batch, Law(60, 1), 1e-3, orders)
        found.append((one._rows.clone(), one.both.parameters.clone()))
    for ours, expected in zip(*found, strict=True):
        torch.testing.assert_close(ours, expected)


def curve(folder):
    with (folder / "training.csv").open(newline="") as file:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)]


def interrupted_at(steps):
    def show(stage, done, total):
        if done >= steps:
            raise KeyboardInterrupt

    return show


def test_an_interruption_changes_no_bit_of_the_result(tmp_path):
    whole, cut = (options(tmp_path, name, timesteps=1000, every=400) for name in ("whole", "cut"))
    train_native_ppo.train(whole)
    for steps in (200, 600):  # before the first checkpoint, and between others
        with pytest.raises(KeyboardInterrupt):
            train_native_ppo.train(cut, interrupted_at(steps))
    train_native_ppo.train(cut)
    assert curve(cut.out) == curve(whole.out)
    assert [int(row["timesteps"]) for row in curve(cut.out)] == [0, 416, 832, 1040]
    for name in ("policy/weights.pt", "checkpoint/000000001040/model.pt"):
        assert (cut.out / name).read_bytes() == (whole.out / name).read_bytes()


def test_a_short_training_lowers_the_error_of_a_bare_plant(tmp_path, monkeypatch):
    monkeypatch.setattr(evaluation, "SAMPLES", 300)
    more = "  n_envs: 64\n  batch_size: 512\n  learning_rate: 2.0e-3\n  net_arch: [32, 32]\n"
    asked = options(
        tmp_path, more=more, plants=(BARE,), timesteps=64 * 16 * 60, episode=200, every=10**6,
        threads=1,
    )  # fmt: skip
    folder = train_native_ppo.train(asked)
    untrained, trained = (float(row["rmse_um"]) for row in curve(asked.out))
    assert trained < 0.5 * untrained
    # The policy is one like any other, on a CPU.
    policy = Policy.load(folder)
    controller = LearnedController(policy, BARE, policy.layout)
    action, _ = controller.predict(np.zeros((2, policy.layout.size), np.float32))
    assert action.shape == (2, 1)


def test_other_devices_are_other_trainings_and_what_was_before_is_as_it_was(tmp_path):
    asked = options(tmp_path)
    train_native_ppo.train(asked)
    assert json.loads((asked.out / "config.json").read_text())["options"]["device"] == "cpu"
    with pytest.raises(InputError, match=r"options.device 'cpu', asked for is None"):
        train_native_ppo.train(replace(asked, device=None))
    assert asked.file("native-ppo") == asked.hyperparameters
    own = replace(asked, hyperparameters=None)
    assert own.file("native-ppo").name == "native-ppo-device.yml"
    assert replace(own, device=None).file("native-ppo").name == "native-ppo.yml"
    assert own.file("native-ppo").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["native-ppo", "--device", "gpu"], "device 'gpu' is none that torch knows"),
        (["native-ppo", "--device", "cpu", "--action", "correction"], "baseline does not run on a torch"),
        (["native-ppo", "--device", "cpu", "--lanes", "3"], "3 lanes for 4 plants"),
        (["native-ppo", "--device", "cpu", "--tensorboard"], "writes no TensorBoard logs"),
        (["ppo", "--device", "cpu"], "--device is no option of ppo; leave it out"),
        (["sac", "--device", "cuda"], "--device is no option of sac; leave it out"),
        pytest.param(
            ["native-ppo", "--device", "cuda"], "no CUDA device is there; give 'cpu'",
            marks=pytest.mark.skipif(torch.cuda.is_available(), reason="a CUDA device is there"),
        ),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, capsys, words, message):
    pytest.importorskip("stable_baselines3")
    (tmp_path / "device.yml").write_text(YAML)
    given = ["--action", "increment"] if "--action" not in words else []
    out = ["--out", str(tmp_path / "run"), "--hyperparameters", str(tmp_path / "device.yml")]
    assert main(["train", *words, *given, *out]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert message in lines[0]
    assert not (tmp_path / "run").exists()


def test_the_command_trains_on_a_device(tmp_path, capsys):
    (tmp_path / "device.yml").write_text(YAML)
    words = [
        "train",
        "native-ppo",
        "--device",
        "cpu",
        "--action",
        "increment",
        "--timesteps",
        "208",
    ]
    out = ["--out", str(tmp_path / "run"), "--hyperparameters", str(tmp_path / "device.yml")]
    assert main([*words, *out]) == 0
    assert "on held-out plants: RMSE" in capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "checkpoint", "config.json", "curve.png", "policy", "training.csv", "training.html",
    ]  # fmt: skip


def test_a_training_that_diverges_says_so(tmp_path):
    with pytest.raises(InputError, match=r"diverged .* lower learning_rate"):
        train_native_ppo.train(options(tmp_path, more="  learning_rate: 1.0e+38\n"))
