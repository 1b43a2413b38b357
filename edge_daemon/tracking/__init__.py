"""Tracking on the road plane: detections to road points, road points to tracks of vehicles."""

from edge_daemon.tracking.measurement import RoadPoints, to_road_points
from edge_daemon.tracking.sightings import Indices, SightingBuffer, Sightings
from edge_daemon.tracking.tracker import HIGH_SCORE, Track, Tracker

__all__ = [
    "HIGH_SCORE",
    "Indices",
    "RoadPoints",
    "SightingBuffer",
    "Sightings",
    "Track",
    "Tracker",
    "to_road_points",
]
