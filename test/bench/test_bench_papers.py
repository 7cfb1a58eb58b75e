"""The bench of the papers writes its tables into their pages."""

import re

import numpy as np
import pytest

from bench.papers import close_neighbours, pages, run, villalba
from bench.papers.pages import Section, filled, markdown, places_in, spread

PAGE = "# A\n\n<!-- measured: one, written by `x --write` -->\nold\n<!-- end: one -->\n\nB\n"


def test_a_table_takes_the_place_of_the_last_and_nothing_else_changes():
    new = filled(PAGE, [Section("one", markdown(("a", "b"), [["1", "2"]]))])
    assert new.startswith("# A\n\n<!-- measured: one,")
    assert new.endswith("\n\n| a | b |\n| --- | --- |\n| 1 | 2 |\n\n<!-- end: one -->\n\nB\n")
    assert filled(new, [Section("one", "old")]) == PAGE.replace("\nold\n", "\n\nold\n\n")


def test_a_table_without_a_place_and_a_place_without_an_end_are_refused():
    with pytest.raises(ValueError, match="two: the page has no place of this name, only one"):
        filled(PAGE, [Section("two", "")])
    with pytest.raises(ValueError, match="each needs both comments"):
        places_in(PAGE.replace("<!-- end: one -->", ""))


@pytest.mark.parametrize("paper", run.PAPERS)
def test_every_place_of_a_page_has_been_written_or_waits_for_it(paper):
    text = (pages.PAGES / f"{paper}.md").read_text(encoding="utf-8")
    places = places_in(text)
    assert "runs" in places
    assert len(places) == len(set(places))
    assert all(f"papers.run {paper}" in one for one in re.findall(r"<!-- measured: [^>]*-->", text))


def test_a_spread_is_mean_median_and_root_mean_square():
    assert spread([1.0, 2.0, 6.0, np.nan]) == "3.00 / 2.00 / 3.70"
    assert spread([]) == "–"


def test_two_roofs_lie_a_gap_and_a_step_apart():
    found = close_neighbours.pair(1.0, 3.0, 5.0, 0.0, 1)
    low, high = (found.area.points[found.area.roof == k] for k in (0, 1))
    assert high[:, 2].mean() - low[:, 2].mean() == pytest.approx(3.0, abs=0.05)
    assert high[:, 1].min() - low[:, 1].max() >= 0.8
    near = found.area.points[found.in_gap, 1]
    assert near.min() > 9.0
    assert near.max() < 12.0


def test_an_even_plane_rises_as_asked():
    plane = villalba.even_plane(0.1)
    slope = np.polyfit(plane.points[:, 0], plane.points[:, 2], 1)[0]
    assert slope == pytest.approx(0.1, abs=0.002)
    assert plane.is_ground.all()
