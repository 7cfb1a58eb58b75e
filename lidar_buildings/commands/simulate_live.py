"""``lidar-buildings simulate`` with a scanner on the move: published, as a bag, as files."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.simulation import SimulationConfig, make_scene
from lidar_buildings.simulation.live import BodyPose, MovingSurvey, Scan, VehicleConfig, drive, fly
from lidar_buildings.simulation.live.messages import SurveyBag
from lidar_buildings.simulation.live.vehicle import PULSE_RATE_OF_BEAM
from lidar_buildings.simulation.survey import NOWHERE, SurveyFiles, check_airborne, check_folder

Event = Scan | BodyPose


def simulate_live_command(options: argparse.Namespace) -> int:
    """Make a survey scan by scan, publish or write it; OutputError or ParameterError if it cannot be."""
    if not (options.live or options.bag or options.output):
        raise ParameterError(NOWHERE)
    survey = survey_of(options)
    if options.output is not None:
        check_folder(options.output, options.overwrite)
    with ExitStack() as stack:
        files: list[list[Path]] = []
        recorders: list[Callable[[Event], None]] = []
        if options.bag is not None:
            bag = SurveyBag(options.bag, survey, with_tf=options.tf, with_fix=options.fix)
            recorders.append(stack.enter_context(bag).add)
            files.append(bag.files)
        if options.output is not None:
            written = stack.enter_context(SurveyFiles(options.output, survey.scene))
            recorders.append(partial(_add_returns, written))
            files.append(written.files)
        duration = sum(leg.duration for leg in survey.legs)
        print(
            f"{options.scene}: {options.scanner} scanner, {len(survey.scene.buildings)} buildings, "
            f"{len(survey.legs)} legs, {duration:.1f} s at {survey.legs[0].speed:.1f} m/s"
        )
        needed = " ".join(f"--set {name}={value}" for name, value in survey.settings.items())
        print(f"  parameters for the reader: {needed}")
        events = _recorded(survey, recorders)
        if options.live:
            _publish(options, survey, events)
        else:
            n_points = sum(len(event.truth.points) for event in events if isinstance(event, Scan))
            print(f"{n_points:,} points")
    for path in chain.from_iterable(files):
        print(f"  {path}")
    return 0


def survey_of(options: argparse.Namespace) -> MovingSurvey:
    """Return the survey that a command line asks for."""
    scene = make_scene(options.scene, options.seed, details=options.details)
    if options.scanner == "vehicle":
        if options.density is not None:
            raise ParameterError(
                "--density applies only to the airborne scanner: use --pulse-rate for a vehicle"
            )
        return drive(scene, options.seed, _vehicle_config(options))
    check_airborne(options)
    rate = options.pulse_rate
    config = SimulationConfig() if options.density is None else SimulationConfig(density=options.density)
    return fly(scene, options.seed, config, rate)


def _vehicle_config(options: argparse.Namespace) -> VehicleConfig:
    given: dict[str, Any] = {"is_profiler": options.profile}
    if options.beams is not None:
        # as many directions in a turn, whatever the number of rays above one another
        given |= {"beams": options.beams, "pulse_rate": PULSE_RATE_OF_BEAM * max(options.beams, 1)}
    for name, value in (("pulse_rate", options.pulse_rate), ("highest_deg", options.top)):
        if value is not None:
            given[name] = value
    if options.pose_noise is not None:
        given["position_noise"], given["angle_noise_deg"] = options.pose_noise
    if options.pose_drift is not None:
        given["position_drift"], given["angle_drift_deg"] = options.pose_drift
    return VehicleConfig(**given)


def _recorded(survey: MovingSurvey, recorders: Iterable[Callable[[Event], None]]) -> Iterator[Event]:
    for event in survey.events():
        for record in recorders:
            record(event)
        yield event


def _add_returns(files: SurveyFiles, event: Event) -> None:
    if isinstance(event, Scan) and len(event.truth.points):
        files.add(int(event.truth.point_source_id[0]), event.truth)


def _publish(options: argparse.Namespace, survey: MovingSurvey, events: Iterator[Event]) -> None:
    from lidar_buildings.ros.middleware import prepare_middleware

    prepare_middleware(carries_scans=True)
    try:
        import rclpy  # after the middleware was prepared
    except ImportError as error:
        raise ParameterError(
            "--live: needs ROS 2 (rclpy), which is not installed: --bag works without it"
        ) from error
    from lidar_buildings.commands.live_publisher import LivePublisher

    with rclpy.Context() as context:  # which leaves signals to Python
        publisher = LivePublisher(
            survey,
            context,
            options.namespace or "",
            with_tf=options.tf,
            with_fix=options.fix,
            is_reliable=options.reliable,
        )
        if options.tf and not publisher.has_tf:
            print("  tf2_msgs is not installed: /tf and /tf_static are not published")
        with suppress(KeyboardInterrupt):
            if options.wait:
                print(f"waiting for a subscriber to {publisher.scan_topic}", flush=True)
                publisher.wait()
            publisher.play(events)
        print(publisher.report, flush=True)
        publisher.close()
