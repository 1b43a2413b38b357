"""Tables of reports."""

from __future__ import annotations

from slipstream_cli.tables import markdown_table


def test_a_tables_first_column_is_text_and_the_others_figures() -> None:
    """Heads, alignment, and a line a row."""
    assert markdown_table(("arm", "kWh"), [("B", 12.5), ("C", "–")]) == (
        "| arm | kWh |\n| --- | --: |\n| B | 12.5 |\n| C | – |"
    )


def test_other_columns_can_be_text() -> None:
    """Alignment by column; a table may have no rows."""
    assert (
        markdown_table(("n", "what", "s"), [], left=(1,)) == "| n | what | s |\n| --: | --- | --: |"
    )
