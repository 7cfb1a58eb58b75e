from bench.ground import noise


def test_the_benchmark_of_gross_errors_prints_a_row_per_density(capsys, monkeypatch):
    monkeypatch.setattr(noise, "SIZES", (3,))
    monkeypatch.setattr(noise, "N_POINTS", 2000)
    noise.main(["--seeds", "1", "--densities", "1", "4"])
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[2:]]
    assert [row[0] for row in rows] == ["1", "4"]
    assert all(len(row) == 2 + len(noise.DEPTHS) for row in rows)
    # Three points 15 m and 40 m below any of these terrains are errors beyond doubt.
    assert all(float(share) > 70.0 for row in rows for share in row[4:6])
