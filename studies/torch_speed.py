"""Throughput of the plant and of the whole tracking step in torch, beside the numba kernels.

    python -m studies.torch_speed

Runs on the CUDA device where there is one, else on the CPU. A step cannot be faster than the
memory moves what it must read and write: the copying of as many bytes on the same device is
measured in turn with the steps, round after round, and its time over the step's is the share of
the memory limit that is reached. On one thread of a CPU the process's own CPU time counts, so that
other programs disturb little.
"""

from __future__ import annotations

import platform
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
import torch

from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.plant import Plant, PlantModel, empty_state, named_plant, pack
from rdpi_gym.plant.cores.play import rdpi_block
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.torch_plant import TorchPlant, TorchTracking
from rdpi_gym.torch_plant.device import checked_device
from rdpi_gym.torch_plant.stages import has_twin

Run: TypeAlias = Callable[[], Any]

RESULTS = Path(__file__).parent / "results" / "torch_speed"
TS_S = 1e-4
LANES = (1_000, 10_000, 100_000, 1_000_000)
_REFERENCE_BYTES = 256_000_000


def plant_model() -> PlantModel:
    """The paper's plant with ten plays, its rate low-passed as in the environment."""
    model = named_plant("P10")
    return model.with_hysteresis(model.hysteresis.band_limited(800.0))


def seconds_per_call(run: Run, device: torch.device, duration_s: float) -> float:
    """Time one call (s) over calls that take `duration_s` together."""
    own_time = device.type == "cpu" and torch.get_num_threads() == 1
    clock = time.process_time if own_time else time.perf_counter
    calls = 1
    while True:
        start = clock()
        for _ in range(calls):
            run()
        if device.type == "cuda":
            torch.cuda.synchronize(device)
        elapsed = clock() - start
        if elapsed >= duration_s:
            return elapsed / calls
        calls *= 2


def captured(step: Callable[[torch.Tensor], object], argument: torch.Tensor) -> Run:
    """Return the replay of a CUDA graph of one step, whose argument stays where it is."""
    for _ in range(3):
        step(argument)
    torch.cuda.synchronize(argument.device)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        step(argument)
    return lambda: graph.replay()


def least_bytes(tensors: Iterable[torch.Tensor], read_and_written: Iterable[torch.Tensor]) -> int:
    """Bytes that a step must move: tensors read or written once, and those read and written."""
    once = sum(tensor.nbytes for tensor in tensors)
    return once + 2 * sum(tensor.nbytes for tensor in read_and_written)


def hysteresis_state(plant: TorchPlant) -> list[torch.Tensor]:
    """Return what a bare plant remembers: last command, rate, plays."""
    return [plant.state.u_V, plant.state.rate_V_s, *plant.state.xi_V]


def copying(moved: int, device: torch.device) -> Run:
    """Return a copy that reads and writes `moved` bytes in all."""
    source = torch.zeros(moved // 8, dtype=torch.float32, device=device)
    target = torch.empty_like(source)
    return lambda: target.copy_(source)


def in_torch(step: Callable[[torch.Tensor], object], argument: torch.Tensor) -> dict[str, Run]:
    """Return the ways to run one step: as it is, compiled, and on CUDA captured as well."""
    torch.compiler.reset()
    compiled = torch.compile(step, fullgraph=True, dynamic=False)
    runs: dict[str, Run] = {
        "torch": partial(step, argument),
        "torch compiled": partial(compiled, argument),
    }
    if argument.is_cuda:
        runs["torch captured"] = captured(step, argument)
        runs["torch compiled and captured"] = captured(compiled, argument)
    return runs


def plant_case(lanes: int, device: torch.device, per_lane: bool) -> tuple[dict[str, Run], int]:
    """Return one step of the bare plant in each implementation, and the bytes it must move."""
    model = plant_model()
    plant = TorchPlant(model, TS_S, lanes, device)
    if per_lane:
        plant.parameters = plant.parameters.randomised(0.1, lanes)
    u = 60.0 * torch.rand(lanes, dtype=torch.float64, device=device) - 30.0
    runs = in_torch(plant.step, u)
    if per_lane:  # the kernels always have parameters for each lane
        p = np.repeat(pack([model.hysteresis], TS_S, [0.0]), lanes, axis=1)
        state, command = empty_state(model.hysteresis.n, lanes), u.cpu().numpy()[None]
        runs["numba (float64, one core)"] = partial(
            rdpi_block, command, p, state, TS_S, np.empty_like(command)
        )
    moved = least_bytes([*plant.parameters, u, u], hysteresis_state(plant))
    return runs, moved


def tracking_case(lanes: int, device: torch.device, per_lane: bool) -> tuple[dict[str, Run], int]:
    """Return the whole step: action, plant, observation, reward; as :func:`plant_case`."""
    model = plant_model()
    layout = ObservationLayout.for_plant(model, ts_s=TS_S, preview=8)
    task = TorchTracking(model, layout, lanes, device=device)
    if per_lane:
        task.plant.parameters = task.plant.parameters.randomised(0.1, lanes)
    samples = max(layout.preview + 1, min(2000, _REFERENCE_BYTES // (4 * lanes)))
    shown = task.reset(torch.zeros((samples, lanes), device=device))
    action = 0.6 * torch.rand(lanes, device=device) - 0.3
    runs = in_torch(task.step, action)
    kernels = TrackingTask([model] * lanes, layout)
    kernels.reset(np.zeros((layout.preview + 1, lanes)))
    command = layout.place_to_V(action.cpu().numpy().astype(float))
    runs["numba (float64, one core)"] = partial(kernels.step, command)
    written = [task.displacement_um, task.error_um, action]  # as large as the reward
    reference = [shown[:, : layout.preview + 1]]
    kept = [*hysteresis_state(task.plant), task.command_V, task.saturated]
    moved = least_bytes([*task.plant.parameters, action, shown, *written, *reference], kept)
    return runs, moved


Case: TypeAlias = Callable[[int, torch.device], tuple[dict[str, Run], int]]
CASES: dict[tuple[str, str], Case] = {
    ("plant", "shared"): lambda lanes, device: plant_case(lanes, device, per_lane=False),
    ("plant", "per lane"): lambda lanes, device: plant_case(lanes, device, per_lane=True),
    ("tracking", "per lane"): lambda lanes, device: tracking_case(lanes, device, per_lane=True),
}


def measure(
    lanes: Sequence[int], device: torch.device, rounds: int, duration_s: float
) -> Iterator[dict[str, Any]]:
    """Measure every case at every number of lanes; yields rows of the table as they are done."""
    for count in lanes:
        for (workload, parameters), case in CASES.items():
            runs, moved = case(count, device)
            runs["copy"] = copying(moved, device)
            for run in runs.values():
                run()  # compiles
            times = pd.DataFrame(
                [
                    {name: seconds_per_call(run, device, duration_s) for name, run in runs.items()}
                    for _ in range(rounds)
                ]
            )
            copy_s = times.pop("copy")
            for name in times:
                on_device = "torch" in str(name)
                median = float(times[name].median())
                share = float((copy_s / times[name]).median())
                yield {
                    "workload": workload,
                    "parameters": parameters,
                    "lanes": count,
                    "implementation": name,
                    "steps_per_s": f"{count / median:.3g}",
                    "bytes_per_step": round(moved / count) if on_device else "",
                    "GB_per_s": f"{moved / median / 1e9:.3g}" if on_device else "",
                    "copy_GB_per_s": f"{moved / copy_s.median() / 1e9:.3g}" if on_device else "",
                    "share_of_limit": f"{share:.2f}" if on_device else "",
                }


def agreement(device: torch.device, samples: int = 2000, lanes: int = 64) -> pd.DataFrame:
    """Largest difference from the float64 kernels over a run, relative to the stroke."""
    measured = named_plant("picma")
    cases = {
        "P10, rate low-passed at 800 Hz": (plant_model(), torch.float64),
        "the same, with every effect of the catalogue": (
            replace(
                plant_model(),
                effects=tuple(kind() for kind in CATALOGUE.values() if has_twin(kind)),
            ),
            torch.float64,
        ),
        "picma, literal rate": (measured, torch.float64),
        "the same, commands rounded to float32": (measured, torch.float32),
    }
    frequency_hz = np.geomspace(1.0, 100.0, lanes)
    place = np.sin(2.0 * np.pi * frequency_hz * TS_S * np.arange(samples)[:, None])
    rows = []
    for name, (model, given) in cases.items():
        low, high = model.command_range_V
        u = low + 0.5 * (place + 1.0) * (high - low)
        y = Plant(model, TS_S, lanes).simulate(u)
        commands = torch.from_numpy(u).to(device, given)
        row: dict[str, Any] = {"plant": name, "samples": samples, "stroke_um": round(np.ptp(y), 1)}
        for dtype in (torch.float32, torch.float64):
            ours = TorchPlant(model, TS_S, lanes, device, dtype).simulate(commands).to(dtype)
            deviation = np.abs(ours.cpu().numpy() - y).max() / np.ptp(y)
            row[f"plays in {str(dtype).removeprefix('torch.')}"] = float(f"{deviation:.1e}")
        rows.append(row)
    return pd.DataFrame(rows)


def as_markdown(
    speed: pd.DataFrame, agreed: pd.DataFrame, device: torch.device, rounds: int, duration_s: float
) -> str:
    """Return both tables with what was measured and how."""
    if device.type == "cuda":
        where = torch.cuda.get_device_name(device)
    else:
        where = f"CPU, {platform.machine()}, {torch.get_num_threads()} thread(s)"
    return (
        "# The batched step in torch\n\n"
        f"Written by `python -m studies.torch_speed`; device: {where}. Plant P10 (ten plays), Ts = "
        f"{TS_S:g} s, rate low-passed at 800 Hz; plays in float32. `plant` is the bare plant, `tracking` "
        "the whole step: action, plant, observation with eight samples ahead, reward. A step is one "
        "sample of one lane. `bytes_per_step` is what must be read and written at the least, "
        "`copy_GB_per_s` the rate at which the device copies as many bytes, `share_of_limit` the time "
        f"of that copy over the time of the step. Medians of {rounds} rounds of {duration_s:g} s, all "
        f"in turn.\n\n{frame_table(speed, digits=None, rule='tight')}\n\n"
        "## Agreement with the kernels\n\n"
        "Largest difference of the displacement from the float64 kernels over 64 lanes, relative to "
        f"the stroke (peak to peak).\n\n{frame_table(agreed, digits=None, rule='tight')}\n\n"
        f"torch {version('torch')}, NumPy {version('numpy')}, numba {version('numba')}, "
        f"Python {platform.python_version()}.\n"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and write them as CSV and Markdown."""
    options = Options("torch_speed", __doc__, out=RESULTS)
    options.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    options.add_argument("--lanes", type=int, nargs="+", default=LANES)
    options.add_number("--rounds", 5, "of timing")
    options.add_argument("--seconds", type=float, default=0.1, help="of each measurement")
    options.add_number("--threads", 1, "of torch on a CPU")
    return options.run(arguments, _measure_all)


def _measure_all(chosen: Namespace) -> None:
    torch.set_num_threads(chosen.threads)
    device = checked_device(chosen.device)
    rows = []
    for row in measure(chosen.lanes, device, chosen.rounds, chosen.seconds):
        print(*row.values(), sep=", ", flush=True)
        rows.append(row)
    speed, agreed = pd.DataFrame(rows), agreement(device)
    text = as_markdown(speed, agreed, device, chosen.rounds, chosen.seconds)
    write_atomic(chosen.out / f"{device.type}.csv", speed.to_csv(index=False))
    write_atomic(chosen.out / f"{device.type}-agreement.csv", agreed.to_csv(index=False))
    print(text, f"written to {write_atomic(chosen.out / f'{device.type}.md', text)}", sep="\n")


if __name__ == "__main__":
    sys.exit(main())
