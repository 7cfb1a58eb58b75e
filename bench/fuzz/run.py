"""
Feed what reads messages with what nobody should send: it says so, or reads it right; nothing else.

    python -m bench.fuzz.run [--cases N] [--seed N] [--only TARGET ...]

Each case comes from its own seed. Prints for each target the cases, how many a second, and how often each
error came. Whatever is no `LidarBuildingsError` is printed with its seed and the exit status is 1; so is a
case that takes more than twenty seconds of processor time, or more than 1 GB beyond what was held before.

With `NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=DIR`, a folder of its own, loops raise IndexError where they would
read or write outside an array, which otherwise shows as SIGSEGV at times. The first cases of a new folder
compile, and may take longer than they may: run it twice.
"""

from __future__ import annotations

import argparse
import re
import resource
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from bench.fuzz.targets import TARGETS, Target
from lidar_buildings.core.model.errors import LidarBuildingsError

#: The longest that a case may take [s], and the most that it may allocate [bytes].
LONGEST, MOST = 20.0, 2**30
#: Failures after which a target is given up.
_MAX_FAILURES = 10
#: Outcomes that are printed of a target.
_MAX_LINES = 15
_NUMBERS = re.compile(r"[-+]?\d[\d.e+,]*|nan|inf|'[^']*'|/\S+/")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the fuzzer; return 1 if anything failed as it must not."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=100_000, help="cases of clouds (default: 100,000)")
    parser.add_argument("--seed", type=int, default=0, help="first seed (default: 0)")
    parser.add_argument("--only", nargs="+", choices=TARGETS, default=TARGETS, metavar="TARGET")
    options = parser.parse_args(arguments)
    n_failures = 0
    for name in options.only:
        target, share = TARGETS[name]
        n_failures += _fuzz(name, target, options.seed, max(round(options.cases * share), 1))
    return bool(n_failures)


def _fuzz(name: str, target: Target, seed: int, n_cases: int) -> int:
    """Run one target; print what came of it and return the number of failures."""
    outcomes: Counter[str] = Counter()
    failures = 0
    begin = time.perf_counter()
    with suppress(LidarBuildingsError):  # what it imports counts for no case
        target(np.random.default_rng(seed))
    with Limits() as limits:
        for number in range(n_cases):
            try:
                with limits.of_a_case():
                    outcome = target(np.random.default_rng((seed, number)))
            except LidarBuildingsError as error:
                outcome = f"{type(error).__name__}: {_NUMBERS.sub('#', str(error))[:56]}"
            except Exception:
                failures += 1
                print(f"FAILED {name} --seed {seed}, case {number}:\n{traceback.format_exc()}")
                if failures == _MAX_FAILURES:
                    break
                continue
            outcomes[outcome] += 1
    seconds = time.perf_counter() - begin
    n_done = sum(outcomes.values()) + failures
    print(f"\n{name}: {n_done:,} cases, {n_done / seconds:,.0f}/s, {failures} failed")
    for outcome, number in outcomes.most_common(_MAX_LINES):
        print(f"  {number:>9,}  {outcome}")
    sys.stdout.flush()
    return failures


class Limits:
    """Limits of processor time and memory of each case."""

    def __enter__(self) -> Limits:
        warnings.simplefilter("error")  # numpy says by warnings where numbers go wrong
        self._before = resource.getrlimit(resource.RLIMIT_DATA)
        self._handler = signal.signal(signal.SIGPROF, self._on_alarm)
        resource.setrlimit(resource.RLIMIT_DATA, (_held() + MOST, self._before[1]))
        return self

    def __exit__(self, *_: Any) -> None:
        resource.setrlimit(resource.RLIMIT_DATA, self._before)
        signal.signal(signal.SIGPROF, self._handler)
        warnings.resetwarnings()

    def of_a_case(self) -> _Case:
        """Return what holds for one case."""
        return _Case()

    @staticmethod
    def _on_alarm(*_: Any) -> None:
        raise TimeoutError(f"it took longer than {LONGEST} s")


class _Case:
    def __enter__(self) -> None:
        signal.setitimer(signal.ITIMER_PROF, LONGEST)

    def __exit__(self, *_: Any) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0)


def _held() -> int:
    """Return the bytes of data that the process holds."""
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmData")) * 1024


if __name__ == "__main__":
    raise SystemExit(main())
