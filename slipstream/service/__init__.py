"""The life of a daemon: its parts, status, logs and spans."""

from slipstream.service.service import (
    SUPERVISED,
    LogLimiter,
    Service,
    configure_logging,
    die_with_parent,
    follow_supervisor,
    notify,
    rss_mb,
    set_from_handler,
)
