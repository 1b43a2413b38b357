"""Settings files."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import Field

from slipstream.config import BusSettings, ServiceSettings, Settings, load, read_secret
from slipstream.errors import InputError


class Example(Settings):
    """A settings model."""

    name: str
    bus: BusSettings = BusSettings()
    service: ServiceSettings = ServiceSettings()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nam = 'x'", "nam: unknown key"),
        ("", "name: missing key"),
        ("name = 3", "name: "),
        ("name = 'x'\n[service]\nmetrics_port = 70000", "service.metrics_port: "),
        ("name = 'x'\n[service]\nmetrics_port = '70'", "service.metrics_port: "),
        ("name = 'x'\n[bus]\nconnect = 'tcp/127.0.0.1:1'", "bus.connect: "),
        ("name = 'x'\n[bus]\nconnekt = []", "bus.connekt: unknown key"),
        ("name = ", "not TOML"),
    ],
)
def test_faults_are_one_line_with_file_key_and_mend(
    tmp_path: Path, text: str, expected: str
) -> None:
    """Each fault names the file and the key and says what to do."""
    path = tmp_path / "example.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load(path, Example)
    line = str(caught.value)
    assert line.startswith(str(path))
    assert expected in line
    assert "; " in line
    assert "\n" not in line


class Row(Settings):
    """A table in a list."""

    id: str
    speed_mps: float = 1.0


class Nested(Settings):
    """Tables in tables, in lists and under names of the user's."""

    rows: tuple[Row, ...] = ()
    named: dict[str, Row] = Field(default_factory=dict)
    bus: BusSettings = BusSettings()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("buss = 1", "buss: unknown key; did you mean bus?"),
        ("[bus]\nconect = []", "bus.conect: unknown key; did you mean connect?"),
        ("[[rows]]\nid = 'a'\nspeed = 3.0", "rows.a.speed: unknown key; did you mean speed_mps?"),
        ("[named.x]\nid = 'a'\nsped_mps = 3.0", "named.x.sped_mps: unknown key; did you mean sp"),
        ("xyzzy = 1", "xyzzy: unknown key; remove it or use one of: bus, named, rows"),
    ],
)
def test_an_unknown_key_names_the_nearest_of_its_table(
    tmp_path: Path, text: str, expected: str
) -> None:
    """Of the table that it is in, however deep."""
    path = tmp_path / "nested.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load(path, Nested)
    assert f"{path}: {expected}" in str(caught.value)


def test_further_faults_stand_beside_the_first(tmp_path: Path) -> None:
    """As many as are told, the misspelt key first; a key that it left missing is none of them."""
    path = tmp_path / "example.toml"
    path.write_text("nam = 'x'\n[service]\nmetrics_port = 70000\nlog_level = 'LOUD'")
    with pytest.raises(InputError) as caught:
        load(path, Example)
    assert caught.value.key == "nam"
    assert [fault.key for fault in caught.value.others] == [
        "service.log_level",
        "service.metrics_port",
    ]


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    """A path that cannot be read is bad input, not a crash."""
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(InputError, match=str(path)):
            load(path, Example)


def test_passwords_in_addresses_are_not_shown(tmp_path: Path) -> None:
    """A faulty address is named by its key, not by its content."""
    path = tmp_path / "example.toml"
    path.write_text("name = 'x'\n[bus]\nconnect = 'tls/user:hunter2@host://x'")
    with pytest.raises(InputError) as caught:
        load(path, Example)
    assert "bus.connect" in str(caught.value)
    assert "hunter2" not in str(caught.value)


def test_binary_is_not_toml(tmp_path: Path) -> None:
    """A file that is no text is refused."""
    path = tmp_path / "x.toml"
    path.write_bytes(b"\x89PNG\r\n")
    with pytest.raises(InputError, match=r"x\.toml: line 1: not TOML: not UTF-8"):
        load(path, Example)


def test_defaults_listen_and_talk_on_loopback_only() -> None:
    """Nothing is open to the world by default."""
    assert all("127.0.0.1" in endpoint for endpoint in BusSettings().connect)
    assert ServiceSettings().metrics_port == 0


@pytest.mark.parametrize("given", ["user = 'edge-north'", "password_file = 'bus-password'"])
def test_a_user_without_a_password_is_one_line(tmp_path: Path, given: str) -> None:
    """Neither makes sense without the other."""
    path = tmp_path / "edge.toml"
    path.write_text(f"name = 'x'\n[bus]\n{given}\n")
    with pytest.raises(InputError, match=r"edge.toml: bus: user and password_file go together"):
        load(path, Example)


def test_a_secret_is_looked_for_among_the_services_credentials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plain name is systemd's credential where there is one; other paths are paths."""
    credentials = tmp_path / "credentials"
    credentials.mkdir()
    (credentials / "bus-password").write_text("from systemd\n")
    (tmp_path / "bus-password").write_text("from the folder\n")
    (tmp_path / "other").write_text("other\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CREDENTIALS_DIRECTORY", raising=False)
    assert read_secret(Path("bus-password")) == "from the folder"
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(credentials))
    assert read_secret(Path("bus-password")) == "from systemd"
    assert read_secret(tmp_path / "bus-password") == "from the folder"
    assert read_secret(Path("other")) == "other"
    (credentials / "bus-password").write_text("\n")
    with pytest.raises(InputError, match="credentials/bus-password: empty"):
        read_secret(Path("bus-password"))
    with pytest.raises(InputError, match="no such file"):
        read_secret(Path("missing"))
