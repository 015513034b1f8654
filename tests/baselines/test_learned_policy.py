"""A saved policy: whole or refused, and read without executing anything."""

import hashlib
import json
import pickle
import subprocess
import sys
import zipfile
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from baselines import make_controller
from baselines.learned import policy as policies
from baselines.learned.controller import find_learned
from baselines.learned.policy import Network, Policy, policy_folder
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError
from tests.baselines.playing import make_policy

P10 = named_plant("P10")


def layout(**fields):
    return ObservationLayout.for_plant(P10, ts_s=1e-4, **({"preview": 2} | fields))


def test_a_policy_comes_back_as_it_was_saved_and_another_takes_its_place(tmp_path):
    saved = make_policy(training={"algorithm": "ppo", "seed": 3})
    folder = saved.save(tmp_path / "policy")
    assert sorted(path.name for path in folder.iterdir()) == ["policy.json", "weights.pt"]
    found, x = Policy.load(folder), torch.randn(5, 14)
    assert (found.layout, found.history, found.baseline) == (saved.layout, 3, "classical-static")
    assert (found.frequency_hz, found.error, found.training) == (100.0, 0.02, saved.training)
    assert torch.equal(found.actor(x), saved.actor(x))
    assert not any(p.requires_grad for p in found.actor.parameters())
    make_policy(seed=1).save(folder)
    assert [path.name for path in tmp_path.iterdir()] == ["policy"]
    assert torch.equal(Policy.load(folder).actor(x), make_policy(seed=1).actor(x))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="holds no policy"):
        make_policy().save(tmp_path / "other")
    assert (tmp_path / "other" / "thesis.txt").read_text() == "mine"


def changed(folder, **fields):
    path = folder / "policy.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | fields))
    return folder


def widths(*values):
    return {"widths": list(values), "activation": "Tanh", "output": "Hardtanh"}


REFUSED = (
    ({"version": 2}, "version 2"),
    ({"format": "rdpi-plant"}, "rdpi-plant"),
    ({"history": 4}, "another observation layout"),
    ({"network": widths(14, 9, 1)}, "does not fit"),
    ({"network": widths(14, 8, 8, 1)}, "does not fit"),
    ({"network": widths(15, 8, 1)}, "does not fit"),
    ({"network": {**widths(14, 8, 1), "activation": "os.system"}}, "os.system"),
    ({"baseline": None}, "correction"),
    ({"scaling": {"frequency_hz": 100.0, "error": 0.0}}, "error is 0"),
    ({"scaling": None}, "does not describe"),
    ({"layout": {"preview": 2}}, "does not describe"),
    ({"baseline": "notes:open_me"}, "'notes:open_me' is no controller of this package"),
    ({"baseline": "learned:ppo-correction"}, "is no controller of this package"),
    ({"baseline": ["pi"]}, "is no controller of this package"),
    ({"history": True}, "history is True"),
    ({"history": 10**9}, "history is 1000000000"),
    ({"network": widths(14, 10**6, 1)}, "widths are"),
    ({"network": widths(14, *[8] * 1000, 1)}, "64 at most"),
    ({"network": {**widths(14, 8, 1), "output": ["Tanh"]}}, "activation"),
    ({"network": {**widths(14, 8, 1), "extra": 1}}, "does not describe"),
    ({"network": [1]}, "does not describe"),
    ({"scaling": {"frequency_hz": "100", "error": 0.02}}, "'100' is no number"),
    ({"training": 3}, "training is no mapping"),
    ({"weights_sha256": 3}, "is not the file that was saved with it"),
)


def test_a_folder_that_fits_nothing_is_one_line(tmp_path):
    folder = make_policy().save(tmp_path / "policy")

    def refused(message, case):
        with pytest.raises(InputError, match=message) as caught:
            Policy.load(folder)
        assert "\n" not in str(caught.value), case

    for fields, message in REFUSED:
        make_policy().save(folder)
        changed(folder, **fields)
        refused(message, fields)
    for name in ("policy.json", "weights.pt"):
        for part in (0.0, 0.5, 0.98):
            make_policy().save(folder)
            content = (folder / name).read_bytes()
            (folder / name).write_bytes(content[: int(part * len(content))])
            refused("cut off", (name, part))
    for weights in ([1, 2], {"0.bias": torch.zeros(8)}, torch.zeros(3)):
        with_weights(folder, weights)
        refused(r"weights\.pt (does not fit the network|holds a)", weights)
    with torch.no_grad():
        policy = make_policy()
        policy.actor[0].bias[2] = float("nan")
    policy.save(folder)
    refused(r"weights.pt holds a weight in '0.bias' that is not fin", "NaN")


def test_a_file_beside_a_policy_is_not_imported(tmp_path, monkeypatch):
    folder = changed(make_policy().save(tmp_path / "policy"), baseline="notes:open_me")
    (tmp_path / "notes.py").write_text("open('ran', 'w')\ndef open_me(*_): ...\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="is no controller of this package"):
        make_controller(f"learned:{folder}", P10, layout(preview=4))
    assert not (tmp_path / "ran").exists()


def with_weights(folder, weights):
    """A policy whose description agrees with other weights."""
    torch.save(weights, folder / "weights.pt")
    digest = hashlib.sha256((folder / "weights.pt").read_bytes()).hexdigest()
    return changed(folder, weights_sha256=digest)


def packed_again(path, compression=zipfile.ZIP_STORED, pickled=None):
    """Write an archive again, perhaps with another pickle in it; return its digest."""
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in entries.items():
            archive.writestr(name, pickled if pickled and name.endswith(".pkl") else content)
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_weights_of_a_billion_numbers_in_a_small_file_are_refused(tmp_path):
    folder = make_policy().save(tmp_path / "policy")
    weights = dict(Policy.load(folder).actor.state_dict())
    weights["0.bias"] = torch.zeros(1).expand(2**33)
    assert (with_weights(folder, weights) / "weights.pt").stat().st_size < 10_000
    with pytest.raises(InputError, match=r"does not fit the network: '0\.bias' is not 8 numbers"):
        Policy.load(folder)


def test_weights_that_expand_are_refused(tmp_path):
    folder = make_policy().save(tmp_path / "policy")
    digest = packed_again(folder / "weights.pt", zipfile.ZIP_DEFLATED)
    with pytest.raises(InputError, match=r"weights\.pt holds no weights alone"):
        Policy.load(changed(folder, weights_sha256=digest))


class Bomb:
    def __reduce__(self):
        return (sys.exit, ("code of a policy was executed",))


def test_weights_that_carry_code_are_refused_and_the_code_is_not_run(tmp_path):
    folder = make_policy().save(tmp_path / "policy")
    digest = packed_again(folder / "weights.pt", pickled=pickle.dumps(Bomb(), protocol=2))
    with pytest.raises(InputError, match=r"weights\.pt holds no weights alone"):
        Policy.load(changed(folder, weights_sha256=digest))


def test_the_folder_of_a_policy_is_a_controllers_name(tmp_path):
    folder = make_policy().save(tmp_path / "policy")
    controller = make_controller(f"learned:{folder}", P10, layout(preview=4))
    assert controller.policy.layout.preview == controller.needed_preview == 2
    assert controller.warning() is None


def test_a_name_without_a_policy_is_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(make_policy().save(tmp_path / "policy"))
    with pytest.raises(InputError, match="the name of the policy is empty"):
        policy_folder("")
    with pytest.raises(InputError, match=r"no policy is at .*nowhere.*policy\.json"):
        policy_folder(str(tmp_path / "nowhere"))


def test_a_network_that_cannot_be_kept_is_refused():
    from torch import nn

    with pytest.raises(InputError, match="Dropout"):
        Network.of([nn.Linear(3, 3), nn.Dropout(), nn.Linear(3, 1), nn.Tanh()])


def test_every_shipped_policy_is_whole_and_all_are_small():
    folders = sorted(policies.SHIPPED.glob("*/policy.json"))
    for path in folders:
        policy = find_learned(path.parent.name)
        controller = make_controller(
            f"learned:{path.parent.name}", P10, replace(policy.layout, action="command")
        )
        shown = np.zeros((2, policy.layout.size), dtype=np.float32)
        assert np.isfinite(controller.predict(shown)[0]).all()
    size = sum(path.stat().st_size for path in policies.SHIPPED.glob("*/*"))
    assert size < 2**20


def test_torch_is_not_loaded_before_a_learned_controller_is_asked_for():
    code = (
        "import sys, rdpi_gym, baselines, benchmarks.tracking.run, rdpi_gym.cli;"
        "from rdpi_gym.cli import main; main(['--help']);"
        "sys.exit('torch' in sys.modules or 'stable_baselines3' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert run.returncode == 0, run.stderr
