"""A small georeferenced network, and the official schemas where the machine has them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jsonschema_rs
import pytest
from lxml import etree

from dispatcher_daemon.service.feeds import EXTENSION_SCHEMA
from slipstream.roads import RoadNetwork
from slipstream.roads.projection import Projection
from slipstream.roads.sumo_net import load_network

Check = Callable[[bytes], None]
"""Fails where a document is not valid."""
TROY = Projection(
    "+proj=utm +zone=18 +ellps=WGS84 +datum=WGS84 +units=m +no_defs", (-605160.10, -4727192.42)
)


@pytest.fixture(scope="session")
def roads() -> RoadNetwork:
    """The demo's roads, as if they lay in Troy, NY."""
    return replace(load_network("demo"), projection=TROY)


def _official(name: str, schema: str) -> Path:
    beside = Path(__file__).resolve().parents[5] / "shared" / "data" / "feed-schemas"
    folder = Path(os.environ.get("FEED_SCHEMAS", beside)) / name
    if not (folder / schema).is_file():
        pytest.skip(f"no {schema} in {folder}: docs/feeds.md says where FEED_SCHEMAS are from")
    return folder


@pytest.fixture(scope="session")
def official_datex2() -> Check:
    """Checks a document against the official schemas of DATEX II v3, and ours in it."""
    folder = _official("datex2", "DATEXII_3_D2Payload.xsd")
    both = "".join(
        f'<xs:import namespace="{namespace}" schemaLocation="{path.as_uri()}"/>'
        for namespace, path in (
            ("http://datex2.eu/schema/3/d2Payload", folder / "DATEXII_3_D2Payload.xsd"),
            ("urn:slipstream:datex2:1", Path(str(EXTENSION_SCHEMA))),
        )
    )
    schema = etree.XMLSchema(
        etree.fromstring(
            f'<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema">{both}</xs:schema>'
        )
    )
    return lambda document: schema.assertValid(etree.fromstring(document))


@pytest.fixture(scope="session")
def official_wzdx() -> Check:
    """Checks a document against the official schema of WZDx 4.2."""
    folder = _official("wzdx", "DeviceFeed.json")

    def retrieve(uri: str) -> object:
        return json.loads((folder / uri.rsplit("/", 1)[-1]).read_text())

    validator = jsonschema_rs.Draft7Validator(
        json.loads((folder / "DeviceFeed.json").read_text()),
        validate_formats=True,
        retriever=retrieve,
    )
    return lambda document: validator.validate(json.loads(document))
