"""Progress is drawn in place on a terminal, and printed as occasional lines elsewhere."""

import io

from pioneer_demo.console.terminal import Display


class FakeTerminal(io.StringIO):
    def isatty(self):
        return True


def test_without_a_terminal_lines_are_not_repeated_at_once():
    output = io.StringIO()
    display = Display(output)
    for _ in range(10):
        display.show(lambda: ["one", "two"], "driving")
    assert output.getvalue() == "one\ntwo\n"


def test_lines_are_not_asked_for_before_it_is_time_to_show_them():
    display, asked = Display(io.StringIO()), []
    for _ in range(10):
        display.show(lambda: asked.append("once") or ["one"], "driving")
    assert asked == ["once"]


def test_a_new_phase_is_shown_at_once():
    output = io.StringIO()
    display = Display(output)
    display.show(lambda: ["waiting for a"], "a")
    display.show(lambda: ["waiting for b"], "b")
    assert output.getvalue() == "waiting for a\nwaiting for b\n"


def test_on_a_terminal_the_block_is_drawn_over_itself_and_fits_its_width():
    output = FakeTerminal()
    display = Display(output, columns=lambda: 20)
    display.show(lambda: ["x" * 50, "second"], "a")
    display.show(lambda: ["third"], "b")
    first, again = output.getvalue().split("\x1b[2F")
    assert "x" * 19 + "\n" in first
    assert "x" * 20 not in first
    assert again == "\x1b[Jthird\n"


HOSTILE = "\x1b[2J\x1b]0;title\x07\rpioneer1 \x9b31m\nis fine"


def test_texts_of_other_programs_do_not_control_the_terminal():
    output = FakeTerminal()
    display = Display(output, columns=lambda: 200)
    display.say(HOSTILE)
    display.show(lambda: [HOSTILE, display.painted("fine", good=True)])
    shown = output.getvalue().replace("\x1b[J", "").replace("\x1b[32mfine\x1b[0m", "")
    assert all(char.isprintable() or char == "\n" for char in shown)
    assert "title" in shown


def test_a_line_feed_in_a_text_does_not_break_the_block():
    output = FakeTerminal()
    display = Display(output, columns=lambda: 200)
    display.show(lambda: ["one\ntwo"], "a")
    display.show(lambda: ["three"], "b")
    assert output.getvalue().endswith("\x1b[1F\x1b[Jthree\n")
