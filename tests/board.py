"""The firmware on an emulated board: QEMU, what its two UARTs lead to, and its power switch.

    board.py CAN MODBUS CONTROL

runs it until it is ended. The three are QEMU's character devices, such as pty, null or
socket,path=PATH,server=on,wait=off: for the two UARTs, and for QEMU's monitor. The power is off.
"""

from __future__ import annotations

import os
import re
import struct
import subprocess
import sys
import zlib
from collections.abc import Sequence
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
IMAGES = REPOSITORY / "build" / "firmware"

#: An instruction takes 16 ns, and the board no less time than a real one: on a busy machine all of
#: it runs slower, its clock included, and nothing in it is late for that.
STEADY = "shift=4,align=on"
#: Without floating point in the processor 10 kHz take more instructions than that.
SOFT = "shift=1,align=on"

#: By image: the machine, where its page of settings is (its linker script), and how its
#: instructions are counted.
MACHINES = {
    "cortex-m3": ("mps2-an385", 0x0007F000, SOFT),
    "cortex-m4f": ("mps2-an386", 0x0007F000, STEADY),
    "cortex-m7": ("mps2-an500", 0x0007F000, STEADY),
    "cortex-m33": ("mps2-an505", 0x1007F000, STEADY),
}
IMAGE = "cortex-m4f"

# Settings (drivers/firmware/axt_settings.h): where a host has to wait for its turn on a busy
# machine, the drive waits for its host.
_SIGNATURE = b"STXA"
_NODE, _STREAM_DECIMATION, _HOST_TIMEOUT = 1, 10, 5000
_EXCITED = 1  # a flag


def board_command(
    can: str,
    modbus: str,
    control: str,
    image: str = IMAGE,
    icount: str | None = None,
    more: Sequence[str] = (),
    excited: bool = False,
) -> list[str]:
    """What runs an image of IMAGES, with ``more`` options of QEMU's.

    ``icount``: how its instructions are counted, where that is not as MACHINES has it.
    ``excited``: its axis moves from the start.
    """
    machine, settings, steady = MACHINES[image]
    numbers = (_NODE, _STREAM_DECIMATION, _HOST_TIMEOUT, _EXCITED if excited else 0)
    page = struct.pack("<4s4I", _SIGNATURE, *numbers)
    page += struct.pack("<I", zlib.crc32(page))
    words = struct.unpack(f"<{len(page) // 4}I", page)
    loaders = [
        f"loader,addr={settings + 4 * i:#x},data={word:#x},data-len=4"
        for i, word in enumerate(words)
    ]
    return [
        *("qemu-system-arm", "-machine", machine, "-nodefaults", "-nographic", "-nic", "none"),
        *("-icount", icount or steady, *more),
        *("-kernel", str(IMAGES / f"{image}.elf")),
        *(argument for loader in loaders for argument in ("-device", loader)),
        *("-chardev", f"{can},id=can", "-serial", "chardev:can"),
        *("-chardev", f"{modbus},id=modbus", "-serial", "chardev:modbus"),
        *("-chardev", f"{control},id=control", "-mon", "control", "-S"),
    ]


class Board:
    """A board whose UARTs lead to ``can`` and ``modbus``. Use it as a context manager.

    QEMU is handed the file descriptors ``fds`` that these mention. ``terminal`` is the one that a
    pty for CAN leads to. In a guest the board is outside, as tests/tools/with-vcan has started it,
    with a terminal of the guest for CAN. ``excited``: its axis moves from the start.
    """

    def __init__(
        self,
        can: str = "null",
        modbus: str = "null",
        fds: Sequence[int] = (),
        excited: bool = False,
    ) -> None:
        device = os.environ.get("AXISTWIN_BOARD_CONTROL")
        self._process: subprocess.Popen[bytes] | None = None
        self.terminal = os.environ.get("AXISTWIN_BOARD_TERMINAL", "")
        if device:
            self._control = os.open(device, os.O_WRONLY)
            return
        self._process = subprocess.Popen(
            board_command(can, modbus, "stdio", excited=excited),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=fds,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._control = self._process.stdin.fileno()
        if can == "pty":
            line = self._process.stdout.readline()
            found = re.search(rb"redirected to (\S+) \(label can\)", line)
            assert found, line
            self.terminal = found[1].decode()

    def __enter__(self) -> Board:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switches it off for good."""
        self.kill()
        if self._process is None:
            os.close(self._control)
        else:
            self._process.kill()
            self._process.communicate()

    def start(self) -> None:
        """Switches the power on, also after kill()."""
        self._say("system_reset", "cont")

    def kill(self) -> None:
        """Switches the power off."""
        self._say("stop")

    def _say(self, *commands: str) -> None:
        os.write(self._control, "".join(f"{command}\n" for command in commands).encode())


def main() -> None:
    """Becomes QEMU."""
    can, modbus, control = sys.argv[1:]
    command = board_command(can, modbus, control)
    os.execvp(command[0], command)


if __name__ == "__main__":
    main()
