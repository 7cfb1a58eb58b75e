"""How far a run is, told by a clock that the test turns: lines where nobody looks, a bar on a terminal."""

import sys

import pytest

from lidar_buildings.commands.progress import TilesDone, progress_bar, progress_words


@pytest.mark.parametrize(
    ("n_finished", "n_tiles", "done", "seconds", "words"),
    [
        (0, 4, TilesDone(), 3.0, "0 of 4 tiles done"),
        (1, 4, TilesDone(1, 500_000, 1), 2.0, "1 of 4 tiles done, 1 building, 0.25 M points/s, 6 s left"),
        # three were done by the run that was interrupted: speed and time left are this one's
        (
            4,
            8,
            TilesDone(1, 40_000_000, 2000),
            90.0,
            "4 of 8 tiles done, 2,000 buildings, 0.44 M points/s, 6 min left",
        ),
        (1, 400, TilesDone(1, 10, 0), 99.0, "1 of 400 tiles done, 0 buildings, 0.00 M points/s, 11 h left"),
        (4, 4, TilesDone(4, 800_000, 7), 8.0, "4 of 4 tiles done, 7 buildings, 0.10 M points/s"),
        (2, 4, TilesDone(), 1.0, "2 of 4 tiles done"),
    ],
)
def test_words_tell_tiles_buildings_speed_and_time_left(n_finished, n_tiles, done, seconds, words):
    assert progress_words(n_finished, n_tiles, done, seconds) == words


def shown(capsys, *steps, n_tiles=2, **options):
    """What stands on stderr after some calls, between which one second passes."""
    seconds = iter(range(100))
    with progress_bar(lambda: n_tiles, clock=lambda: next(seconds), **options) as show:
        for step in steps:
            show(*step)
    return capsys.readouterr().err


FIRST, SECOND = (1, TilesDone(1, 1_000_000, 3)), (2, TilesDone(2, 3_000_000, 5))


def test_a_line_is_written_for_each_tile_and_none_twice(capsys):
    assert shown(capsys, (0, TilesDone()), FIRST, (*FIRST, ["plane_fitter"]), SECOND).splitlines() == [
        "1 of 2 tiles done, 3 buildings, 0.50 M points/s, 2 s left",
        "2 of 2 tiles done, 5 buildings, 0.75 M points/s",
    ]


@pytest.mark.parametrize("no_colour", ["", "1"])
def test_a_terminal_has_a_bar_with_what_is_at_work_in_colour_unless_told_otherwise(
    capsys, monkeypatch, no_colour
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("NO_COLOR", no_colour)
    text = shown(capsys, (*FIRST, ["ground_filter", "plane_fitter"]), SECOND)
    assert "1 of 2 tiles done, 3 buildings, 1.00 M points/s, 1 s left; ground_filter, plane_fitter" in text
    assert "\r 50%|" in text
    assert "\r100%|" in text
    assert ("\x1b[" in text) == (not no_colour)
