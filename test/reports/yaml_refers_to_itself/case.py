from support.report_cases import Case, run_of


def case(folder, house):
    path = folder / "self.yaml"
    path.write_text("ground_filter: &a\n  ros__parameters: *a\n")
    arguments = [*run_of(folder, house / "strip_01.laz"), "--params", path]
    return Case(arguments, status=2, says=["self.yaml: an anchor refers to itself"], n_lines=1)
