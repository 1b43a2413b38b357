"""The bus: a session, its routers, and what arrives on it."""

from slipstream.bus.session import KEPT, Bus, Publisher, Router, free_port
