"""What tests let workers do; these import it by its name."""

import os
import time


def process_of(job):
    return job, os.getpid()


def twice(job):
    return 2 * job


def fail(job):
    raise ValueError(f"{job} broke")


def end(job):
    os._exit(9)


def wait_for(job):
    """Say that it has begun, and wait for a file."""
    began, awaited = job
    began.touch()
    while not awaited.exists():
        time.sleep(0.02)
    return "done"
