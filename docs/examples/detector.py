"""A detector that obeys: it does real work at the rate that a file asks for, and says which rate it reaches.

usage: python docs/examples/detector.py --rate 5
       python docs/examples/detector.py --rates rates.json

A frame is a picture of 640 by 480 points, filtered at five scales by Fourier transforms. Once a second the rate
that was reached is printed. `--rates` watches the file of `eadp replan --publish`; `--rate` stays.

`--meter DIR` stands for a power sensor on a computer without one: it writes DIR/class/hwmon/hwmon0/power1_input, the
power that the process' time on the processor stands for, IDLE_W and CORE_W for a whole core.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import threading
import time
from pathlib import Path

import numpy as np

SHAPE, SCALES = (480, 640), (1.0, 2.0, 4.0, 8.0, 16.0)
IDLE_W, CORE_W, METER_S = 2.0, 10.0, 1.0


def frame(rng: np.random.Generator) -> float:
    """Look at a picture: the largest difference of neighbouring scales."""
    spectrum = np.fft.rfft2(rng.random(SHAPE))
    fx, fy = np.fft.rfftfreq(SHAPE[1]), np.fft.fftfreq(SHAPE[0])[:, np.newaxis]
    blurred = [np.fft.irfft2(spectrum * np.exp(-2 * (np.pi * s) ** 2 * (fx**2 + fy**2)), SHAPE) for s in SCALES]
    return max(float(np.abs(a - b).max()) for a, b in itertools.pairwise(blurred))


def asked(file: str, name: str, before: float) -> float:
    """The rate that a file asks for; the one before where it says none."""
    try:
        return float(json.loads(Path(file).read_text())["parameters"][name])
    except (OSError, ValueError, LookupError):
        return before


def meter(folder: str) -> None:
    """Write the power for ever."""
    chip = Path(folder) / "class/hwmon/hwmon0"
    chip.mkdir(parents=True, exist_ok=True)
    (chip / "name").write_text("detector\n")
    spent, then = time.process_time(), time.monotonic()
    while True:
        time.sleep(METER_S)
        share = (time.process_time() - spent) / (time.monotonic() - then)
        spent, then = time.process_time(), time.monotonic()
        (chip / "part").write_text(f"{round(1e6 * (IDLE_W + CORE_W * share))}\n")
        os.replace(chip / "part", chip / "power1_input")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rate", type=float, default=2.0)
    parser.add_argument("--rates")
    parser.add_argument("--name", default="fps")
    parser.add_argument("--meter")
    options = parser.parse_args()
    if options.meter:
        threading.Thread(target=meter, args=(options.meter,), daemon=True).start()
    rng, rate = np.random.default_rng(0), options.rate
    started = due = time.monotonic()
    count = 0
    while True:
        if options.rates:
            rate = asked(options.rates, options.name, rate)
        frame(rng)
        count += 1
        now = time.monotonic()
        if now - started >= 1:
            print(f"{count / (now - started):.2f}", flush=True)
            started, count = now, 0
        due = max(due + 1 / rate, now)
        time.sleep(due - now)


if __name__ == "__main__":
    main()
