"""Time of the first answers of a fresh installation: ``python -m benchmarks.first_answer``.

Each answer is asked for in a process of its own, with an empty folder of compiled kernels, then again
with the kernels that the first one left. Processor time is that of the process and its children.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ANSWERS = {
    "import, rg.fit": "import rdpi_gym as rg; rg.fit",
    "env.step": """
import gymnasium as gym, numpy as np, rdpi_gym
env = gym.make("rdpi_gym/PiezoTracking-v0")
env.reset(seed=0)
env.step(np.zeros(1, np.float32))""",
    "rdpi fit, the shipped example": """
from rdpi_gym.cli import main
from rdpi_gym.measurement import example_folder
main(["fit", str(example_folder("picma"))])""",
}


def seconds(code: str, folder: Path) -> tuple[float, float]:
    """Wall time and processor time (s) of a process that runs code with the kernels of a folder."""
    kernels = folder / "kernels"
    kernels.mkdir(exist_ok=True)
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder, env=os.environ | {"NUMBA_CACHE_DIR": str(kernels)},
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure, and print the table."""
    print("| answer | cold (s) | processor (s) | kernels | warm (s) | processor (s) |")
    print("|---|---|---|---|---|---|")
    for name, code in ANSWERS.items():
        with tempfile.TemporaryDirectory(prefix="first-answer-") as temporary:
            folder = Path(temporary)
            cold = seconds(code, folder)
            kernels = sum(1 for _ in folder.rglob("*.nbi"))
            warm = seconds(code, folder)
        figures = [f"{value:.2f}" for value in (*cold, *warm)]
        print("|", " | ".join([name, *figures[:2], str(kernels), *figures[2:]]), "|", flush=True)


if __name__ == "__main__":
    main()
