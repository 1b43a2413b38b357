"""A SUMO configuration and additional files of the user's."""

from __future__ import annotations

from pathlib import Path

import pytest

from slipstream.errors import InputError
from slipstream_lab.simulation.scenarios.networks.route_files import check_additional, check_routes
from slipstream_lab.simulation.sumo import read_configuration, without_output

INPUT = '<input><net-file value="a.net.xml"/><r v="b.rou.xml,c.rou.xml"/>{}</input>'


def _configuration(folder: Path, text: str) -> Path:
    for name in ("a.net.xml", "b.rou.xml", "c.rou.xml", "d.add.xml"):
        (folder / name).touch()
    path = folder / "x.sumocfg"
    path.write_text(text)
    return path


def test_files_and_times_are_taken_and_the_rest_is_named(tmp_path: Path) -> None:
    """Files stand relative to the configuration, also by SUMO's short names; times have colons."""
    more = '<additional value="d.add.xml"/>'
    path = _configuration(
        tmp_path,
        f"<sumoConfiguration>{INPUT.format(more)}"
        '<time><begin value="1:07:30:00"/><end value="-1"/><step-length value="0.5"/></time>'
        '<processing><scale value="2"/></processing><report><verbose value="true"/></report>'
        "</sumoConfiguration>",
    )
    files = read_configuration(path)
    assert files.net == tmp_path / "a.net.xml"
    assert files.routes == (tmp_path / "b.rou.xml", tmp_path / "c.rou.xml")
    assert files.additional == (tmp_path / "d.add.xml",)
    assert (files.begin_s, files.end_s) == (113400.0, None)
    assert files.ignored == ("scale",)
    assert (
        read_configuration(
            _configuration(tmp_path, f"<configuration>{INPUT.format('')}</configuration>")
        ).begin_s
        == 0.0
    )


def test_names_of_files_are_read_as_sumo_writes_them(tmp_path: Path) -> None:
    """With %20 for a blank and %2C for a comma; as they are where such a file exists."""
    for name in ("my net.net.xml", "a,b.rou.xml", "50%20.add.xml"):
        (tmp_path / name).touch()
    files = read_configuration(
        _configuration(
            tmp_path,
            '<configuration><net-file value="my%20net.net.xml"/>'
            '<route-files value="a%2Cb.rou.xml, b.rou.xml"/>'
            '<additional-files value="50%20.add.xml,d.add.xml"/></configuration>',
        )
    )
    assert files.net == tmp_path / "my net.net.xml"
    assert [path.name for path in files.routes] == ["a,b.rou.xml", "b.rou.xml"]
    assert [path.name for path in files.additional] == ["50%20.add.xml", "d.add.xml"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<routes/>", "no SUMO configuration: a <routes>"),
        ("<configuration/>", "net-file: it names no net-file"),
        (f"<configuration>{INPUT.format('')}", "not XML"),
        (
            f"<configuration>{INPUT.format('<a value=' + chr(34) + 'gone.xml' + chr(34) + '/>')}"
            "</configuration>",
            "additional-files: it names 'gone.xml', which is not there",
        ),
        (
            f'<configuration>{INPUT.format("")}<time><begin value="soon"/></time></configuration>',
            "begin: 'soon' is no time",
        ),
    ],
)
def test_a_configuration_that_is_none_is_one_line(tmp_path: Path, text: str, told: str) -> None:
    """What is missing or wrong is told with its option."""
    path = _configuration(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_configuration(path)
    assert str(caught.value).startswith(str(path))
    assert told in str(caught.value)


def test_additional_files_write_nothing_where_the_user_keeps_them(tmp_path: Path) -> None:
    """A copy has no output and finds its input; a file without output is taken as it is."""
    given, quiet, made = tmp_path / "given", tmp_path / "quiet.add.xml", tmp_path / "made"
    given.mkdir()
    loud = given / "loud.add.xml"
    text = (
        '<additional><e1Detector id="d" lane="a_0" pos="1" file="mine.xml"/>'
        '<variableSpeedSign id="v" lanes="a_0" file="speeds.xml"/></additional>'
    )
    loud.write_text(text)
    quiet.write_text('<additional><vType id="a"/></additional>')
    copy, same = without_output((loud, quiet), made)
    assert same == quiet
    assert copy.parent == made
    assert 'file="NUL"' in copy.read_text()
    assert f'file="{given / "speeds.xml"}"' in copy.read_text()
    assert loud.read_text() == text


def test_a_copy_that_another_seed_reads_is_never_cut_short(tmp_path: Path) -> None:
    """The same content is not written again; another one comes under the name as a whole."""
    given, made = tmp_path / "loud.add.xml", tmp_path / "made"
    text = '<additional><e1Detector id="d" lane="a_0" pos="1" file="{}"/></additional>'
    given.write_text(text.format("mine.xml"))
    (copy,) = without_output((given,), made)
    with copy.open() as reading:
        before = copy.stat()
        assert without_output((given,), made) == (copy,)
        assert copy.stat() == before
        given.write_text(text.format("mine.xml").replace('"d"', '"e"'))
        without_output((given,), made)
        assert 'id="d"' in reading.read()
    assert 'id="e"' in copy.read_text()
    assert list(made.iterdir()) == [copy]


def test_an_include_is_refused(tmp_path: Path) -> None:
    """What stands in the other file would be neither checked nor kept from writing."""
    path = tmp_path / "a.add.xml"
    path.write_text('<additional><include href="detectors.xml"/></additional>')
    for check in (lambda: without_output((path,), tmp_path), lambda: check_additional((path,))):
        with pytest.raises(InputError, match=r"a\.add\.xml: detectors\.xml: an <include>"):
            check()
    path.write_text('<routes><include href="more.rou.xml"/></routes>')
    with pytest.raises(InputError, match="an <include>"):
        check_routes((path,), ["ab"])
