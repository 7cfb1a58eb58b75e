"""Every case of the gallery gives what its README says; see support/report_cases.py for a new one."""

import logging

import pytest
from support.report_cases import LINES, case_folders, module_of, told


@pytest.mark.parametrize("folder", case_folders(), ids=lambda folder: folder.name)
def test_a_reported_case_gives_what_is_expected(folder, house, command, tmp_path, caplog):
    assert list(told(folder)) == list(LINES)
    case = module_of(folder).case(tmp_path, house)
    if case.arguments:
        with caplog.at_level(logging.WARNING):
            spoken = command(*case.arguments)
        # what the logger says goes to stderr where pytest does not hold it
        errors = [*spoken.err, *caplog.messages]
        lines = [*spoken.out, *errors]
        assert spoken.status == case.status, lines
        assert [text for text in case.says if not any(text in line for line in lines)] == [], lines
        assert [line for line in lines if any(text in line for text in case.silent)] == []
        assert case.n_lines in (None, len(errors)), errors
        assert not any("Traceback" in line or "Warning: " in line for line in lines), lines
    if case.check is not None:
        case.check()
