"""Images that lie about themselves or would cost more than they are worth."""

import struct
import time
import zlib

import numpy as np
import pytest

from api.errors import Refusal
from api.occupancy import decode_map

YAML = b"{image: m, resolution: 0.5, origin: [0, 0, 0], occupied_thresh: 0.65, free_thresh: 0.2}"
LARGEST = 4096 * 4096


def chunk(kind, data=b""):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width, height, pixels, *more, depth=8, colour=0, interlaced=0):
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, interlaced))
    return b"\x89PNG\r\n\x1a\n" + header + b"".join(more) + chunk(b"IDAT", pixels) + chunk(b"IEND")


DOT = zlib.compress(b"\0\0")
ZEROS = zlib.compress(bytes(200_000_000), 1)

BOMBS = {
    "declared": (png(2**31 - 1, 2**31 - 1, DOT), "payload-too-large"),
    "declared, no more": (png(5000, 5000, DOT)[:33], "payload-too-large"),
    "declared, behind a profile": (
        png(5000, 5000, DOT, chunk(b"iCCP", b"p\0\0" + ZEROS)), "payload-too-large"
    ),
    "pixels that are not there": (png(4096, 4096, DOT), "invalid-request"),
    "a flood of chunks": (png(1, 1, DOT, chunk(b"abCd") * 500_000), "invalid-request"),
    "a flood of text": (png(1, 1, DOT, chunk(b"tEXt", b"k\0v") * 500_000), "invalid-request"),
    "no size": (png(0, 5, DOT), "invalid-request"),
    "an unknown colour type": (png(1, 1, DOT, colour=5), "invalid-request"),
    "a header elsewhere": (
        png(1, 1, DOT)[:8] + chunk(b"tEXt", b"k\0v") + png(1, 1, DOT)[8:], "invalid-request"
    ),
    "two headers": (png(1, 1, DOT, png(9999, 9999, b"")[8:33]), "invalid-request"),
    "a short header": (png(1, 1, DOT)[:8] + chunk(b"IHDR", b"\0\0\0\1"), "invalid-request"),
    "no end": (png(1, 1, DOT)[:-12], "invalid-request"),
    "a long header": (png(1, 1, DOT).replace(b"\0\0\0\rIHDR", b"\xff\xff\xff\xffIHDR"), "invalid-request"),
    "a wrong checksum": (png(1, 1, DOT).replace(chunk(b"IDAT", DOT)[-4:], b"\0\0\0\0"), "invalid-request"),
    "pgm, declared": (b"P5\n5000 5000\n255\n", "payload-too-large"),
    "pgm, digits": (b"P5\n" + b"9" * 1_000_000 + b" 1\n255\n", "invalid-request"),
    "pgm, a long comment": (b"P5\n#" + b"x" * 10_000_000 + b"\n1 1\n255\n\0", "invalid-request"),
    "pgm, many comments": (b"P2\n1 1\n255\n" + b"#\n" * 5_000_000 + b"0 ", "invalid-request"),
    "pgm, a long number": (b"P2\n1 1\n255\n" + b"9" * 10_000_000, "invalid-request"),
    "pgm, a long zero": (b"P2\n2 1\n255\n" + b"0" * 10_000_000 + b" 1", "invalid-request"),
    "pgm, spaces": (b"P2\n2 1\n255\n1" + b" " * 10_000_000, "invalid-request"),
    "pgm, too bright": (b"P5\n2 1\n100\n\x64\x65", "invalid-request"),
    "pgm, no maximum": (b"P5\n2 1\n0\n\0\0", "invalid-request"),
    "pgm, a maximum of 17 bits": (b"P5\n2 1\n65536\n\0\0\0\0", "invalid-request"),
    "pgm, one byte short": (b"P5\n2 1\n65535\n\0\0\0", "invalid-request"),
    "pgm, signed": (b"P2\n2 1\n255\n-1 1", "invalid-request"),
}  # fmt: skip


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_hostile_image_is_refused_in_no_time(bomb):
    image, code = BOMBS[bomb]
    began = time.process_time()
    with pytest.raises(Refusal) as refused:
        decode_map(YAML, image, LARGEST)
    assert refused.value.code == code
    assert time.process_time() - began < 0.5


@pytest.mark.parametrize(
    "image",
    [
        png(1, 1, ZEROS),
        png(1, 1, DOT, chunk(b"iCCP", b"p\0\0" + ZEROS)),
        png(1, 1, DOT, *[chunk(b"zTXt", b"k\0\0" + zlib.compress(bytes(1_000_000)))] * 200),
        png(1, 1, DOT, chunk(b"iTXt", b"k\0\1\0\0\0" + ZEROS)),
    ],
    ids=["pixels", "profile", "texts", "international text"],
)
def test_what_is_compressed_beside_the_pixels_is_never_unpacked(image):
    began = time.process_time()
    assert decode_map(YAML, image, LARGEST).cells.tolist() == [[1]]
    assert time.process_time() - began < 0.5


def test_an_interlaced_image_is_the_same_map():
    grey = np.arange(64, dtype=np.uint8).reshape(8, 8) * 4
    plain = zlib.compress(b"".join(b"\0" + row.tobytes() for row in grey))
    passes = [
        (0, 0, 8, 8),
        (0, 4, 8, 8),
        (4, 0, 8, 4),
        (0, 2, 4, 4),
        (2, 0, 4, 2),
        (0, 1, 2, 2),
        (1, 0, 2, 1),
    ]
    woven = b"".join(b"\0" + row.tobytes() for y, x, dy, dx in passes for row in grey[y::dy, x::dx])
    image = png(8, 8, zlib.compress(woven), interlaced=1)
    assert decode_map(YAML, image, 64).id == decode_map(YAML, png(8, 8, plain), 64).id


def test_comments_spaces_and_other_maxima_of_a_pgm_are_understood():
    plain = decode_map(YAML, b"P5 2 2 255 \x00\xff\x80\xff", 4)
    for image in (
        b"P2\n# GIMP\n2 # wide\r\n#\n2\t255\n0 255\n\n  128\r\n255",
        b"P5\n2 2\n51\n" + bytes([0, 51, 26, 51]),
        b"P5\n2 2\n65535\n" + np.array([0, 65535, 32896, 65535], dtype=">u2").tobytes(),
        b"P2\n2 2\n255\n0 255 128 255 7 9",  # the first image of several
    ):
        assert decode_map(YAML, image, 4).id == plain.id


def test_a_large_plain_pgm_is_read_in_pieces_as_if_in_one():
    values = np.random.default_rng(1).integers(0, 256, (700, 900), dtype=np.uint8)
    text = b"P2\n900 700\n255\n" + b" ".join(b"%d" % v for v in values.ravel())
    binary = b"P5\n900 700\n255\n" + values.tobytes()
    assert decode_map(YAML, text, LARGEST).id == decode_map(YAML, binary, LARGEST).id
