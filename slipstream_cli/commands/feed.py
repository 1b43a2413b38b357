"""`slipstream feed`: what the last stored cycle knew, as road authorities take it."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.errors import InputError
from slipstream.site import load_site

if TYPE_CHECKING:
    from slipstream.messages import SegmentCounts, SegmentState


_CYCLES_LOOKED_AT = 20
"""Last cycles in which states are looked for."""


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("feed", help="the last cycle's states as DATEX II or WZDx")
    command.add_argument("form", choices=("datex2", "wzdx"), help="datex2: v3; wzdx: 4.2")
    command.add_argument(
        "--config",
        type=Path,
        help="the site.toml: network, rsus, database, publisher",
    )
    command.add_argument("--network", help="a SUMO net (default: that of the settings)")
    command.add_argument("--database", help="database URL (default: that of the settings)")
    command.add_argument(
        "--out", type=Path, required=True, help="file for the measured data, or the device feed"
    )
    command.add_argument("--sites", type=Path, help="datex2: file for the measurement site table")
    command.add_argument("--force", action="store_true", help="overwrite files that are there")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the documents of the time at which the cycle began."""
    from dispatcher_daemon.service import feeds
    from dispatcher_daemon.settings import DispatcherSettings
    from slipstream.roads.admission import check_rsus
    from slipstream.roads.sumo_net import load_network

    if options.sites is not None and options.form != "datex2":
        raise InputError("feed", "WZDx has no table of sites", "leave it out", key="--sites")
    if options.sites == options.out:
        raise InputError("feed", "one file for two documents", "give two names", key="--sites")
    settings = DispatcherSettings()
    if options.config is not None:
        settings = load_site(options.config, "dispatcher", DispatcherSettings)
    network = load_network(options.network or settings.network)
    check_rsus(settings.rsus, network, options.config or "dispatcher")
    url = options.database or settings.database_url
    now_ns, states = _last_cycle(url)
    sites = feeds.find_sites(network, feeds.watched_pairs(settings.rsus, states, ()))
    measured = feeds.measurements(
        sites,
        states,
        network,
        now_ns,
        stale_after_s=settings.stale_after_s,
        counts=_counts(url, {site.segment for site in sites}, now_ns),
    )
    documents: dict[Path, bytes] = {}
    if options.form == "wzdx":
        documents[options.out] = feeds.device_feed(measured, {}, settings.feeds, now_ns)
    else:
        documents[options.out] = feeds.measured_data(measured, settings.feeds, now_ns)
        if options.sites is not None:
            documents[options.sites] = feeds.site_table(sites, settings.feeds, now_ns)
    _write(documents, options.force)
    for path in documents:
        print(f"{path}: {len(sites)} sites")
    return 0


def _last_cycle(url: str) -> tuple[int, tuple[SegmentState, ...]]:
    """When the last stored cycle began, UTC ns, and the states that it knew; of the last ones that
    had states if there is one.
    """
    from storage import StorageError, open_reader

    with open_reader(url) as reader:
        try:
            cycle = reader.latest_cycle()
            states: tuple[SegmentState, ...] = ()
            # A failed cycle has none.
            for candidate in reversed(reader.cycles(_CYCLES_LOOKED_AT, gates=False)):
                states = reader.states(candidate.cycle)
                if states:
                    cycle = candidate
                    break
        except StorageError as error:
            raise InputError("feed", str(error), "run slipstream db check") from None
    if cycle is None:
        mend = "give the dispatcher's database_url with --database"
        raise InputError("feed", "no cycle is stored there", mend, key="--database")
    return cycle.started_ns, states


def _counts(url: str, segments: Collection[str], now_ns: int) -> list[SegmentCounts]:
    """What was counted in the hour before."""
    from storage import StorageError, open_reader

    with open_reader(url) as reader:
        try:
            return [
                one
                for segment in segments
                for one in reader.counts(segment, now_ns - 3600 * 10**9, now_ns)
            ]
        except StorageError as error:
            raise InputError("feed", str(error), "run slipstream db check") from None


def _write(documents: Mapping[Path, bytes], overwrite: bool) -> None:
    for path in documents:
        if path.exists() and not overwrite:
            raise InputError(path, "is there already", "give --force, or another name")
        if not path.parent.is_dir():
            raise InputError(path.parent, "no such folder", "make it first")
    for path, body in documents.items():
        part = path.with_name(path.name + ".part")
        try:
            part.write_bytes(body)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
