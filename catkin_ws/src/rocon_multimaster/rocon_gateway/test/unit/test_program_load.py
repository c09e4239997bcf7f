"""Which programs are counted for a computer, and what they use."""

from rocon_gateway.node.program_load import Load, ProgramLoad


def program(root, pid, uri, seconds, kilobytes):
    """Writes a program's /proc files: its master, CPU time and share of memory."""
    folder = root / str(pid)
    folder.mkdir(exist_ok=True)
    (folder / "environ").write_bytes(
        b"PATH=/bin\0ROS_MASTER_URI=" + uri.encode() + b"\0HOME=/root\0"
    )
    ticks = round(100 * seconds)
    (folder / "stat").write_text(
        f"{pid} (a (b) c) S 1 {pid} {pid} 0 -1 4194304 9 0 0 0 {ticks} 0 0 0 20 0 1 0 5 0 0"
    )
    (folder / "smaps_rollup").write_text(
        f"0-f ---p 0 00:00 0 [rollup]\nRss: 9999 kB\nPss: {kilobytes} kB\n"
    )


def test_only_programs_of_the_own_master_are_counted_from_the_second_look_on(tmp_path):
    (tmp_path / "sys").mkdir()
    program(tmp_path, 10, "http://aadi1:11313/", 1.0, 1000)
    program(tmp_path, 11, "http://127.0.0.1:11313", 2.0, 500)
    program(tmp_path, 12, "http://127.0.0.1:11314", 3.0, 4000)
    load = ProgramLoad("http://localhost:11313", tmp_path)
    assert load.look(10.0) == Load(0.0, 1500 * 1024)
    program(tmp_path, 10, "http://aadi1:11313/", 1.5, 1000)
    program(tmp_path, 12, "http://127.0.0.1:11314", 9.0, 4000)
    program(tmp_path, 13, "http://127.0.0.1:11313", 0.5, 100)
    assert load.look(12.0) == Load(0.5, 1600 * 1024)


def test_a_program_that_ends_while_it_is_looked_at_is_left_out(tmp_path):
    program(tmp_path, 10, "http://localhost:11311", 1.0, 1000)
    program(tmp_path, 11, "http://localhost:11311", 1.0, 1000)
    load = ProgramLoad("http://localhost:11311", tmp_path)
    load.look(0.0)
    (tmp_path / "11" / "stat").unlink()
    assert load.look(1.0) == Load(0.0, 1000 * 1024)
