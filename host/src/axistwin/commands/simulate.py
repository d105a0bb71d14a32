"""`axistwin simulate`: what a model of an axis does under the torque of a record."""

from __future__ import annotations

import argparse

import numpy as np

from axistwin import model, readers
from axistwin.core import Array
from axistwin.errors import InputError
from axistwin.record import Record, from_samples, write_csv
from axistwin.terminal import Terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument("model", metavar="MODEL", help="model file (TOML)")
    readers.add_arguments(parser, "--torque")
    parser.add_argument(
        "-f", "--file", required=True, metavar="CSV", help="write the simulated record here"
    )
    model.add_hold_argument(parser)
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="which samples get lost, if any do"
    )


def run(arguments: argparse.Namespace) -> int:
    """Reads, simulates, writes. Returns the exit status."""
    if arguments.seed < 0:
        raise InputError(f"--seed {arguments.seed}: has to be 0 or more")
    axis = model.read(arguments.model)
    given = readers.read(arguments)
    if given.linear != axis.linear:
        kinds = {False: "rotary", True: "linear"}
        raise InputError(
            f"the model is {kinds[axis.linear]}, the record {kinds[given.linear]} (--linear)"
        )
    theta1, theta2 = axis.simulate(given.torque, given.time_step, hold=arguments.hold)
    simulated = _with_losses(
        Record(
            time=given.time,
            torque=given.torque,
            theta1=theta1,
            theta2=theta2,
            time_step=given.time_step,
            source=f"{arguments.model} under the torque of {given.source}",
            warnings=given.warnings,
            linear=given.linear,
        ),
        axis.sample_loss,
        arguments.seed,
    )
    write_csv(simulated, arguments.file)
    Terminal().note(f"{arguments.file}: {len(simulated)} samples, {simulated.duration:.6g} s")
    return 0


def _with_losses(record: Record, share: float, seed: int) -> Record:
    """The record with a share of its samples missing, never the first or the last."""
    if share == 0.0:
        return record
    there = np.random.default_rng(seed).random(len(record)) >= share
    there[[0, -1]] = True

    def left(values: Array) -> Array:
        return values[there]

    return from_samples(
        left(record.time),
        {name: left(values) for name, values in record.channels.items()},
        source=record.source,
        warnings=record.warnings,
        linear=record.linear,
    )
