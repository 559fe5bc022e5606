"""Tables that programs print."""

from rich.console import Console

from humanoid_sim.command_line.tables import titled_table


def test_no_cell_is_cut_off(capsys):
    table = titled_table("files", "name", "size", right=("size",))
    table.add_row("a" * 60, "7")
    Console(width=40).print(table)
    printed = capsys.readouterr().out
    assert printed.count("a") == 60 + "name".count("a")
    assert [column.justify for column in table.columns] == ["left", "right"]
    assert not titled_table("figures").show_header
