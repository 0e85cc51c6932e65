"""Documents get their tables where they name them."""

from galton_experiments.page import quotes


def test_a_document_gets_its_tables_where_it_names_them():
    text = "a\n\n<!-- table: one -->\n\n| old |\n|---|\n\nb\n\n<!-- table: other -->\n\n| stays |\n"
    filled = quotes.filled(text, {"one": "| new |\n|---|\n| 1 |"}.get)
    assert filled == text.replace("| old |\n|---|\n", "| new |\n|---|\n| 1 |\n")
    for same in (filled, text.replace("|\n\nb", "|\nb")):  # a table without a blank line after it swallows the text
        assert quotes.filled(same, {"one": "| new |\n|---|\n| 1 |"}.get) == filled


def test_a_bar_in_a_cell_does_not_end_it():
    assert quotes.markdown(["P(a|b)"], [["1"]]).splitlines()[0] == "| P(a\\|b) |"
