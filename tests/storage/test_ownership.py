"""One dispatcher owns a database, and a database that is gone is noticed before a plan is sent."""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import event

import storage
from slipstream.errors import InputError
from slipstream_cli.main import main
from storage import StorageError, ownership
from storage.ownership import FileOwner

OWNER = """
import sys
import storage
database = storage.open_database(sys.argv[1], owned=True)
print("owned", flush=True)
sys.stdin.read()
"""


def _path(url: str) -> Path:
    return Path(url.removeprefix("sqlite:///"))


@pytest.mark.attack
@pytest.mark.process
def test_the_lock_ends_with_its_process(url):
    """Another process is refused in one line while the first lives; SIGKILL frees the lock."""
    with subprocess.Popen(
        [sys.executable, "-c", OWNER, url],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "owned\n"
        with pytest.raises(InputError, match=rf"another dispatcher \(process {process.pid}\)"):
            storage.open_database(url, owned=True)
        process.kill()
        process.wait()
    storage.open_database(url, owned=True).close()


def test_looking_for_an_owner_makes_nothing(url):
    """It refuses what is owned, by the owner's number, and leaves the rest alone."""
    storage.check_free(url)
    assert not _path(url).parent.exists()
    with (
        storage.open_database(url, owned=True),
        pytest.raises(InputError, match=rf"another dispatcher \(process {os.getpid()}\)"),
    ):
        storage.check_free(url)
    storage.check_free(url)
    storage.check_free("postgresql://nobody@127.0.0.1:1/none")
    storage.open_database(url, owned=True).close()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
def test_a_lock_that_root_made_belongs_to_the_user_of_the_database(url):
    """A command that an administrator ran does not keep the dispatcher's user out."""
    storage.open_database(url).close()
    os.chown(_path(url), 4711, 4712)
    storage.open_database(url, owned=True).close()
    status = _path(url).with_name("slipstream.db-lock").stat()
    assert (status.st_uid, status.st_gid) == (4711, 4712)


def test_a_link_leads_to_the_same_lock(url, tmp_path):
    """The same file by another path is still owned."""
    link = tmp_path / "link.db"
    with storage.open_database(url, owned=True):
        link.symlink_to(_path(url))
        with pytest.raises(InputError, match="another dispatcher"):
            storage.open_database(f"sqlite:///{link}", owned=True)


@pytest.mark.slow
def test_commands_beside_an_owner(url, make_cycle, capsys):
    """Check, prune and upgrade work on a database that a dispatcher writes, and it goes on."""
    with storage.open_database(url, owned=True) as database:
        for number in range(1, 6):
            database.record_cycle(*make_cycle(number))
        assert main(["db", "check", "--url", url]) == 0
        assert main(["db", "prune", "--url", url, "--keep-mb", "0"]) == 0
        assert main(["db", "upgrade", "--url", url]) == 0
        assert "4 cycles deleted" in capsys.readouterr().out
        database.record_cycle(*make_cycle(6))
        assert database.next_cycle_number() == 7
    assert main(["db", "check", "--url", url]) == 0


def _delete(path: Path) -> None:
    path.unlink()


def _delete_all(path: Path) -> None:
    for file in path.parent.glob(f"{path.name}*"):
        file.unlink()


def _delete_folder(path: Path) -> None:
    shutil.rmtree(path.parent)


def _delete_log(path: Path) -> None:
    path.with_name(path.name + "-wal").unlink()


def _delete_lock(path: Path) -> None:
    path.with_name(path.name + "-lock").unlink()


def _restore_backup(path: Path) -> None:
    backup = path.with_name("backup.db")
    with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(backup)) as copy:
        source.backup(copy)
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink()
    backup.replace(path)


def _restore_without_log(path: Path) -> None:
    backup = path.with_name("backup.db")
    shutil.copy(path, backup)
    with closing(sqlite3.connect(backup)) as copy:
        copy.execute("VACUUM")
    backup.replace(path)


def _move(path: Path) -> None:
    path.rename(path.with_name("moved.db"))


@pytest.mark.attack
@pytest.mark.parametrize(
    "lose",
    [
        _delete,
        _delete_all,
        _delete_folder,
        _delete_log,
        _delete_lock,
        _restore_backup,
        _restore_without_log,
        _move,
    ],
)
def test_a_database_that_is_gone_costs_a_cycle(url, make_cycle, lose):
    """The next cycle is not stored; then the path is opened anew, and what is there stays there."""
    with storage.open_database(url, owned=True) as database:
        for number in (1, 2, 3):
            database.record_cycle(*make_cycle(number))
        lose(_path(url))
        for number in (4, 5):
            with pytest.raises(storage.StorageError, match=r"was (deleted|replaced)"):
                database.record_cycle(*make_cycle(number))
        assert database.next_cycle_number() in (1, 4)
        database.record_cycle(*make_cycle(6))
        with storage.open_reader(url) as reader:
            stored = [report.cycle for report in reader.cycles(limit=9)]
    assert stored in ([6], [1, 2, 3, 6])
    kept = lose in (_delete_log, _delete_lock, _restore_backup)
    assert (stored == [1, 2, 3, 6]) == kept
    assert storage.check(url).ok


@pytest.mark.attack
@pytest.mark.parametrize("moment", ["before_cursor_execute", "commit"])
def test_a_file_deleted_in_the_middle_of_a_cycle(url, make_cycle, moment):
    """However late it is deleted before the commit's end, the cycle does not count as stored."""
    with storage.open_database(url, owned=True) as database:
        database.record_cycle(*make_cycle(1))
        event.listen(database._engine, moment, lambda *_, **__: _path(url).unlink(missing_ok=True))
        with pytest.raises(storage.StorageError, match="was deleted"):
            database.record_cycle(*make_cycle(2))
        assert database.next_cycle_number() == 1
        database.record_cycle(*make_cycle(3))


@pytest.mark.attack
def test_what_replaced_the_database_is_checked(url, make_cycle):
    """Another file at the path, or another owner: no cycle is stored until that is mended."""
    path = _path(url)
    with storage.open_database(url, owned=True) as database:
        database.record_cycle(*make_cycle(1))
        kept = path.with_name("kept.db")
        path.rename(kept)
        path.write_text("Dear diary" * 1000)
        with pytest.raises(storage.StorageError, match="was replaced"):
            database.record_cycle(*make_cycle(2))
        for _ in range(2):
            with pytest.raises(storage.StorageError, match="not a database"):
                database.next_cycle_number()
            with pytest.raises(storage.StorageError, match="was replaced"):
                database.record_cycle(*make_cycle(3))
        path.unlink()
        with storage.open_database(url, owned=True) as other:
            with pytest.raises(storage.OwnedError, match="another dispatcher"):
                database.next_cycle_number()
            with pytest.raises(storage.StorageError, match="was replaced"):
                database.record_cycle(*make_cycle(3))
            other.record_cycle(*make_cycle(1))
        assert database.next_cycle_number() == 2
        database.record_cycle(*make_cycle(4))
    with storage.open_reader(url) as reader:
        assert [report.cycle for report in reader.cycles(limit=9)] == [1, 4]


@pytest.mark.parametrize("fault", [errno.EROFS, errno.ENOSPC, errno.EIO])
def test_a_faulty_disk_is_nobodys_bad_input(tmp_path, monkeypatch, fault):
    """It may pass: a daemon that ends for it is started again. Denied access does not pass."""

    def refuse(*_):
        raise OSError(fault, os.strerror(fault))

    monkeypatch.setattr(ownership.os, "open", refuse)
    with pytest.raises(StorageError, match=os.strerror(fault)):
        FileOwner(tmp_path / "slipstream.db")
    fault = errno.EACCES
    with pytest.raises(InputError, match=os.strerror(fault)):
        FileOwner(tmp_path / "slipstream.db")
