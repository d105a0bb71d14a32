"""Time a step on this machine, and the same work done by public Python packages.

Both sides run in this process, in turn, several times; the medians are compared. Only the ratio
says something about other machines.
"""

from __future__ import annotations

import ctypes
import functools
import importlib
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from toolchain import BENCH, HOST, BenchError, build

REPEATS = 9
SAMPLES = 4096  # of a record for both sides
STEPS = 200_000  # of the core alone
FORGETTING = 0.999
AGREE = 1e-3  # relative to the largest entry: both sides must have found the same

Array = NDArray[np.float64]
Estimate = Callable[[], Array]


def library() -> ctypes.CDLL:
    """The core's loops, loaded into this process."""
    sources = [BENCH / "drive.c", BENCH / "speed.c"]
    return ctypes.CDLL(str(build(HOST, "speed.so", sources, ["-shared", "-fPIC"]).resolve()))


def pointer(values: NDArray[np.float32]) -> Any:
    """A C float pointer to an array."""
    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_float))


# With every effect or without, and the steps from one reading of the encoders to the next: as in
# simulations of a 1 kHz record, and as on a drive.
MACHINES = {
    "machine_ideal": (0, 1),
    "machine_every_effect": (1, 20),
    "machine_every_effect_read_each_step": (1, 1),
}


@dataclass(frozen=True)
class Regression:
    """The same equation for everybody: y = theta phi + noise."""

    phi: Array  # (samples, inputs), of size 1
    y: Array  # (samples, outputs)

    def core(self, core: ctypes.CDLL, forgetting: float) -> Estimate:
        """The core's estimator on it."""
        phi = np.ascontiguousarray(self.phi, dtype=np.float32)
        y = np.ascontiguousarray(self.y, dtype=np.float32)
        theta = np.empty((y.shape[1], phi.shape[1]), dtype=np.float32)
        arguments = (
            phi.shape[1],
            y.shape[1],
            ctypes.c_float(forgetting),
            pointer(phi),
            pointer(y),
            phi.shape[0],
            pointer(theta),
        )

        def estimate() -> Array:
            if core.speed_rls(*arguments) != 0:
                raise BenchError("speed: the core refused samples")
            return theta.astype(np.float64)

        return estimate


def regression(samples: int, inputs: int, outputs: int) -> Regression:
    """A reproducible regression problem."""
    generator = np.random.default_rng(1)
    phi = generator.standard_normal((samples, inputs))
    theta = generator.uniform(-1.0, 1.0, (outputs, inputs))
    noise = 1e-3 * generator.standard_normal((samples, outputs))
    return Regression(phi, phi @ theta.T + noise)


def padasip_rls(problem: Regression) -> Estimate:
    """padasip's recursive least squares, one output."""
    filters = importlib.import_module("padasip").filters

    def estimate() -> Array:
        rls = filters.FilterRLS(n=problem.phi.shape[1], mu=FORGETTING, eps=1e-6, w="zeros")
        rls.run(problem.y[:, 0], problem.phi)
        return np.asarray(rls.w)[np.newaxis]

    return estimate


def filterpy_kalman(problem: Regression) -> Estimate:
    """filterpy's Kalman filter with fading memory and constant state, which is RLS; one output."""
    kalman = importlib.import_module("filterpy.kalman")
    inputs = problem.phi.shape[1]

    def estimate() -> Array:
        rls = kalman.KalmanFilter(dim_x=inputs, dim_z=1)
        rls.P = 1e6 * np.eye(inputs)
        rls.Q = np.zeros((inputs, inputs))
        rls.alpha = FORGETTING**-0.5
        for phi, y in zip(problem.phi, problem.y[:, 0], strict=True):
            rls.predict()
            rls.update(y, H=phi[np.newaxis])
        return np.asarray(rls.x).reshape(1, inputs)

    return estimate


def numpy_lstsq(problem: Regression) -> Estimate:
    """numpy's least squares over the whole record at once."""
    return lambda: np.linalg.lstsq(problem.phi, problem.y, rcond=None)[0].T


def scipy_lstsq(problem: Regression) -> Estimate:
    """scipy's least squares over the whole record at once."""
    linalg = importlib.import_module("scipy.linalg")
    return lambda: np.asarray(linalg.lstsq(problem.phi, problem.y)[0]).T


PEERS: dict[str, tuple[str, str, int, float, Callable[[Regression], Estimate]]] = {
    # what: package, name of what is called, outputs, forgetting
    "rls_5x1_padasip": ("padasip", "FilterRLS", 1, FORGETTING, padasip_rls),
    "rls_5x1_filterpy": ("filterpy", "KalmanFilter, fading", 1, FORGETTING, filterpy_kalman),
    "ls_5x4_numpy": ("numpy", "linalg.lstsq", 4, 1.0, numpy_lstsq),
    "ls_5x4_scipy": ("scipy", "linalg.lstsq", 4, 1.0, scipy_lstsq),
}


def nanoseconds(work: Callable[[], object]) -> float:
    """Time of one run."""
    start = time.perf_counter_ns()
    work()
    return float(time.perf_counter_ns() - start)


def compare(core: ctypes.CDLL, what: str) -> dict[str, float | str]:
    """One peer against the core; `ours` and `peer` in nanoseconds a step.

    Raises BenchError when they do not agree on the answer.
    """
    package, called, outputs, forgetting, make_peer = PEERS[what]
    version = importlib.import_module("importlib.metadata").version(package)
    problem = regression(SAMPLES, 5, outputs)
    ours, peer = problem.core(core, forgetting), make_peer(problem)
    difference = float(np.max(np.abs(ours() - peer())) / np.max(np.abs(peer())))
    if not difference <= AGREE:
        raise BenchError(f"{what}: the estimates differ by {difference:.1e} of the largest entry")
    times = [(nanoseconds(ours), nanoseconds(peer)) for _ in range(REPEATS)]
    our_time = statistics.median(time for time, _ in times) / SAMPLES
    peer_time = statistics.median(time for _, time in times) / SAMPLES
    return {
        "ours": our_time,
        "peer": peer_time,
        "peer_name": f"{package} {version} {called}",
        "ratio": peer_time / our_time,
        "difference": difference,
    }


def step_times(core: ctypes.CDLL) -> dict[str, float]:
    """Nanoseconds a step of the core's own loops."""
    torque = np.asarray(0.2 * np.random.default_rng(2).standard_normal(512), dtype=np.float32)
    torque -= torque.mean()
    full, short = regression(STEPS // 10, 5, 4), regression(STEPS // 10, 3, 2)
    works: dict[str, tuple[int, Callable[[], object]]] = {
        "rls_5x4": (len(full.phi), full.core(core, FORGETTING)),
        "rls_3x2": (len(short.phi), short.core(core, FORGETTING)),
        "plant_ideal": (STEPS, lambda: core.speed_plant(pointer(torque), 512, STEPS)),
        **{
            what: (STEPS, functools.partial(core.speed_machine, pointer(torque), 512, STEPS, *how))
            for what, how in MACHINES.items()
        },
        "control_tick": (STEPS, lambda: core.speed_tick(pointer(torque), STEPS)),
    }
    return {
        what: statistics.median(nanoseconds(work) for _ in range(REPEATS)) / steps
        for what, (steps, work) in works.items()
    }
