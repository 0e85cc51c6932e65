"""Python imports this first of all where the folder is on PYTHONPATH, in every process that a command starts.

The kernel then ends a process that binds a socket to a port or listens on one, whatever library asks for it. What
Python unpickles, starts and connects to is written down, a line each, in the file that GALTON_SEALED names.
"""

import ctypes
import json
import os
import platform
import struct
import sys

CALLS = {"x86_64": (0xC000003E, 49, 50), "aarch64": (0xC00000B7, 200, 201)}
"""The architecture as the kernel calls it, and the numbers of bind and listen there."""
STARTED = ("subprocess.Popen", "os.system", "os.exec", "os.spawn", "os.posix_spawn")
NOTED = ("pickle.find_class", "socket.connect", *STARTED)
LOAD, JUMP_IF_EQUAL, RETURN = 0x20, 0x15, 0x06
KILL, ALLOW = 0x80000000, 0x7FFF0000
NETLINK = 12
"""The bytes of an address of the kernel's own messages, by which SDL hears of joysticks; a port's has 16 or 28."""


def forbid_listening() -> None:
    """Have the kernel end this process and all that it starts if they listen, or bind to what is no netlink address."""
    architecture, bind, listen = CALLS[platform.machine()]
    steps = [
        (LOAD, 0, 0, 4),  # the architecture of the call
        (JUMP_IF_EQUAL, 0, 5, architecture),
        (LOAD, 0, 0, 0),  # its number
        (JUMP_IF_EQUAL, 4, 0, listen),
        (JUMP_IF_EQUAL, 0, 2, bind),
        (LOAD, 0, 0, 32),  # the bytes of its address
        (JUMP_IF_EQUAL, 0, 1, NETLINK),
        (RETURN, 0, 0, ALLOW),
        (RETURN, 0, 0, KILL),
    ]
    program = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *step) for step in steps))
    described = ctypes.create_string_buffer(struct.pack("HxxxxxxP", len(steps), ctypes.addressof(program)))
    call = ctypes.CDLL(None, use_errno=True).prctl
    if call(38, 1, 0, 0, 0) or call(22, 2, described, 0, 0):  # no new privileges; a filter
        raise OSError(ctypes.get_errno(), "this kernel takes no filter")


def note(event: str, arguments: tuple[object, ...]) -> None:
    """Write down an event with the modules that led to it."""
    if not event.startswith(NOTED):
        return
    modules, frame = [], sys._getframe(1)
    while frame is not None:
        modules.append(frame.f_globals.get("__name__", "?"))
        frame = frame.f_back
    line = json.dumps([event, [str(argument)[:300] for argument in arguments], list(dict.fromkeys(modules))])
    os.write(_LOG, f"{line}\n".encode())


if os.environ.get("GALTON_SEALED"):
    _LOG = os.open(os.environ["GALTON_SEALED"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    forbid_listening()
    sys.addaudithook(note)
