from bench.roofs import spires


def test_the_benchmark_of_spires_finds_one_of_80_degrees_and_its_tip(capsys):
    spires.main(["--slopes", "80", "--densities", "10", "--plans", "square", "--stands", "free"])
    last = capsys.readouterr().out.split("all")[1].splitlines()[2].split()
    n, points, found, right, *_ = map(float, last)
    assert (n, found, right) == (1, 100.0, 100.0)
    assert points > 90.0
