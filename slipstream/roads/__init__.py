"""The road network, whom its roads admit, and points on it."""

from slipstream.roads.network import Crossing, RoadNetwork, Segment, build_network
