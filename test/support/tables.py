"""Tables that commands print."""


def lines_of(text, first):
    """The words of the lines that begin with a word."""
    return [line.split() for line in text.splitlines() if line.split()[:1] == [first]]
