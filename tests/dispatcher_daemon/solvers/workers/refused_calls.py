"""Runs a command as the shipped units do with the system calls that they refuse: those of systemd's
set @resources end with EPERM, in the command and in all that it starts.

Exit status 77 where this system has no such filters.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import struct
import sys

UNAVAILABLE = 77
# setpriority, sched_setparam, sched_setscheduler, setrlimit, sched_setaffinity, mbind,
# set_mempolicy, ioprio_set, migrate_pages, move_pages, sched_setattr; nice is setpriority in libc.
CALLS = {
    "x86_64": (0xC000003E, (141, 142, 144, 160, 203, 237, 238, 251, 256, 279, 314)),
    "aarch64": (0xC00000B7, (140, 118, 119, 164, 122, 235, 237, 30, 238, 239, 274)),
}
"""(audit name of the architecture, numbers of the calls)."""
_LOAD, _JUMP_IF_EQUAL, _RETURN = 0x20, 0x15, 0x06
_ALLOW, _ERROR = 0x7FFF0000, 0x00050000
_PR_SET_NO_NEW_PRIVS, _PR_SET_SECCOMP, _FILTER = 38, 22, 2


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_char_p))


def refuse(architecture: int, calls: tuple[int, ...]) -> bool:
    """Refuse system calls from here on; False: it cannot be done."""

    def instruction(code: int, value: int, when: int = 0, otherwise: int = 0) -> bytes:
        return struct.pack("HBBI", code, when, otherwise, value)

    rows = [
        instruction(_LOAD, 4),
        instruction(_JUMP_IF_EQUAL, architecture, 0, len(calls) + 1),
        instruction(_LOAD, 0),
        *(instruction(_JUMP_IF_EQUAL, call, len(calls) - i) for i, call in enumerate(calls)),
        instruction(_RETURN, _ALLOW),
        instruction(_RETURN, _ERROR | errno.EPERM),
    ]
    program = _Program(len(rows), b"".join(rows))
    libc = ctypes.CDLL(None, use_errno=True)
    return (
        libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
        and libc.prctl(_PR_SET_SECCOMP, _FILTER, ctypes.byref(program), 0, 0) == 0
    )


def main() -> None:
    """Refuse the calls, then become the command."""
    if platform.machine() not in CALLS or not refuse(*CALLS[platform.machine()]):
        sys.exit(UNAVAILABLE)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, 1)
    except PermissionError:
        os.execv(sys.argv[1], sys.argv[1:])
    sys.exit(UNAVAILABLE)


if __name__ == "__main__":
    main()
