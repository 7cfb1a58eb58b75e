from bench.ground import noise


def test_the_benchmark_of_single_groups_prints_a_row_per_density(capsys, monkeypatch):
    monkeypatch.setattr(noise, "GROUP_SIZES", (3,))
    monkeypatch.setattr(noise, "N_POINTS", 2000)
    noise.main(["--groups", "--densities", "1", "4"])
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[2:]]
    assert [row[0] for row in rows] == ["1", "4"]
    assert all(len(row) == 2 + len(noise.GROUP_DEPTHS) for row in rows)
    # Three points 15 m and 40 m below any of these terrains are errors beyond doubt.
    assert all(float(share) > 70.0 for row in rows for share in row[4:6])


def test_the_benchmark_of_ranges_prints_what_is_found_and_what_ground_stays(capsys, monkeypatch):
    monkeypatch.setattr(noise, "N_POINTS", 2000)
    noise.main(
        ["--scenes", "level", "--densities", "4", "--shares", "1", "3", "--patterns", "scattered", "haze"]
    )
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    share = {row[1]: row[2:] for row in rows if row and row[0] in ("1.0", "3.0") and row[1] == "scattered"}
    found, least, _, ground, *_ = share["scattered"]
    assert min(float(found), float(least)) > 90.0
    assert float(ground) > 99.0
