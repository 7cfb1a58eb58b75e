"""Which counting of references goes."""

from lidar_buildings.core.reference_counts import without_borrowed

TAKE, GIVE = "  call void @NRT_incref(ptr {})", "  tail call void @NRT_decref(ptr {})"


def function(*lines):
    return "\n".join(
        ["define i32 @loop(ptr %retptr, ptr %arg.a.0, ptr %arg.b.0) {", "entry:", *lines, "}", ""]
    )


def counted(*lines):
    """Return the pointers that are still counted."""
    return [
        line.split("(ptr ")[1][:-1]
        for line in without_borrowed(function(*lines)).split("\n")
        if "ref(ptr " in line
    ]


def test_counts_of_arguments_go_whoever_else_is_called():
    assert not counted(
        TAKE.format("%arg.a.0"), "  %1 = call i32 @other(ptr %2, ptr %arg.a.0)", GIVE.format("%arg.a.0")
    )


def test_what_the_function_made_is_counted():
    made = "  %made = call ptr @NRT_MemInfo_alloc_aligned(i64 8)"
    assert counted(made, TAKE.format("%made"), GIVE.format("%made")) == ["%made", "%made"]


def test_a_variable_that_is_named_as_arguments_are_is_counted():
    made = "  %arg.c.0 = call ptr @NRT_MemInfo_alloc_aligned(i64 8)"
    assert counted(made, TAKE.format("%arg.c.0"), GIVE.format("%arg.c.0")) == ["%arg.c.0", "%arg.c.0"]


def test_an_argument_that_is_returned_is_counted():
    stored = "  store ptr %arg.a.0, ptr %retptr, align 8"
    assert counted(TAKE.format("%arg.a.0"), TAKE.format("%arg.b.0"), GIVE.format("%arg.b.0"), stored) == [
        "%arg.a.0"
    ]


def test_names_of_arguments_alone_are_borrowed():
    chosen = "  %chosen = phi ptr [ %arg.a.0, %B1 ], [ null, %B2 ], [ %again, %B3 ]"
    again = "  %again = select i1 %1, ptr %chosen, ptr %arg.b.0"
    assert not counted(TAKE.format("%arg.a.0"), chosen, again, GIVE.format("%chosen"), GIVE.format("%again"))


def test_all_that_a_name_may_stand_for_is_counted_if_one_was_made():
    made = "  %made = call ptr @NRT_MemInfo_alloc_aligned(i64 8)"
    chosen = "  %chosen = phi ptr [ %arg.a.0, %B1 ], [ %made, %B2 ]"
    again = "  %again = phi ptr [ %chosen, %B3 ], [ %arg.b.0, %B4 ]"
    lines = TAKE.format("%arg.a.0"), made, chosen, again, GIVE.format("%again")
    assert counted(*lines) == ["%arg.a.0", "%again"]


def test_functions_are_judged_each_for_itself():
    both = function(TAKE.format("%arg.a.0"), "  store ptr %arg.a.0, ptr %retptr") + function(
        TAKE.format("%arg.a.0"), GIVE.format("%arg.a.0")
    )
    assert without_borrowed(both).count("NRT_") == 1


def test_what_counts_nothing_stays_as_it_is():
    text = "declare void @NRT_incref(ptr)\n" + function("  ret i32 0")
    assert without_borrowed(text) == text
