"""The images themselves: what is linked, and that each runs on its board."""

from __future__ import annotations

import re
import struct
import subprocess

import pytest
from board import IMAGES, MACHINES

from .conftest import Start
from .measure import BEGIN, END, put_into
from .rig import ENABLE, OPEN, command


@pytest.mark.parametrize("image", MACHINES)
def test_no_heap_no_printing_and_no_double_is_linked(image: str) -> None:
    """By the link map: what the linker has kept, functions and data, each in a section its own."""
    text = (IMAGES / f"{image}.map").read_text(encoding="utf-8")
    kept = text[text.index("Linker script and memory map") :]
    symbols = subprocess.run(
        ["arm-none-eabi-nm", str(IMAGES / f"{image}.elf")],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    forbidden = (
        r"\w*(malloc|calloc|realloc|sbrk|printf|__aeabi_d|__aeabi_\w*2d|(add|sub|mul|div)df3)"
    )
    assert re.search(r"\.text\.axt_node_tick\n", kept)
    assert re.findall(rf"\.(?:text|data|bss)\S*\.{forbidden}\w*\n +0x", kept) == []
    assert re.findall(rf"^\w+ \w {forbidden}\w*$", symbols, re.MULTILINE) == []
    assert " axt_node_tick" in symbols


@pytest.mark.parametrize("image", MACHINES)
def test_no_function_takes_stack_of_no_fixed_size(image: str) -> None:
    usage = [file.read_text(encoding="utf-8") for file in (IMAGES / image).rglob("*.su")]
    kinds = [line.split("\t")[2] for text in usage for line in text.splitlines()]
    assert len(kinds) > 300
    assert set(kinds) == {"static"}


@pytest.mark.parametrize("image", MACHINES)
def test_an_image_streams_and_answers_on_its_board(start: Start, image: str) -> None:
    rig = start(image)
    rig.can.write(OPEN + ENABLE + command("StreamStart") + command("ExcitationOn"))
    counters = [struct.unpack_from("<H", rig.can.wait_for("Motor"))[0] for _ in range(1000)]
    assert counters == list(range(counters[0], counters[0] + 1000))
    assert rig.registers("Signature", 3) == (0x4158, 0x5457, 2)
    assert rig.can.wait_for_page("Overruns") == 0


def test_the_rest_of_a_page_stays_when_its_table_is_made_anew() -> None:
    rest = f"and after it\n<!-- another -->\nwhat is made elsewhere\n{END}the end\n"
    page = f"before it\n{BEGIN}an old table\n{END}{rest}"
    assert put_into(page, "a new one\n") == f"before it\n{BEGIN}a new one\n{END}{rest}"
