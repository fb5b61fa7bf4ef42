"""Photos decode as Pillow decodes them and are written as it reads them, hostile ones are refused in a line, and
resizing follows the cameras.
"""

import io
import math
import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pillow_heif
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageOps
from scenes import refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.exif import gravity, taken_with
from tinysplat_runtime.scene.images import MAX_PIXELS, exif_of, image_size, is_turned, read_image
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.resampling import resize_cover, scaled

JPEG_MEAN_LEVELS = 0.5  # of 255, against libjpeg-turbo, whose IDCT rounds otherwise


def photo_like(height: int, width: int, channels: int = 3, seed: int = 0) -> NDArray:
    """(height, width, channels) uint8 with smooth colours, edges and a little noise, as photos have."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width] / 16
    waves = [np.sin(x * (c + 1) / 3 + c) + np.cos(y * (c + 2) / 4) + (x + y > 6 + c) for c in range(channels)]
    return (np.stack(waves, -1) * 40 + 100 + rng.normal(0, 3, (height, width, channels))).clip(0, 255).astype(np.uint8)


def encoded(image: Image.Image, kind: str, **options: object) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def png_of_rows(width: int, height: int, depth: int, colour_type: int, rows: list[bytes], *extra: bytes) -> bytes:
    """A PNG file from unfiltered rows of samples, for the kinds that Pillow cannot write."""
    header = struct.pack(">IIBBBBB", width, height, depth, colour_type, 0, 0, 0)
    body = zlib.compress(b"".join(b"\0" + row for row in rows))
    chunks = [chunk(b"IHDR", header), *extra, chunk(b"IDAT", body), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def read_bytes(folder: Path, data: bytes) -> NDArray:
    (folder / "photo").write_bytes(data)
    return read_image(folder / "photo")


def refusal(folder: Path, data: bytes) -> str:
    with pytest.raises(InputError) as caught:
        read_bytes(folder, data)
    message = str(caught.value)
    assert message.startswith(str(folder / "photo")) and "\n" not in message
    return message


@pytest.mark.parametrize("size", [(64, 96), (63, 95), (17, 8), (1, 1), (2, 3)])
@pytest.mark.parametrize("mode", ["RGB", "L"])
@pytest.mark.parametrize(
    "options",
    [
        {"subsampling": 0},
        {"subsampling": 1},
        {"subsampling": 2},
        {"progressive": True},
        {"restart_marker_blocks": 3},
        {"keep_rgb": True},
    ],
    ids=str,
)
def test_jpeg_matches_pillow_within_half_a_level_on_average(
    tmp_path: Path, size: tuple[int, int], options: dict[str, object], mode: str
) -> None:
    data = encoded(Image.fromarray(photo_like(*size)).convert(mode), "JPEG", quality=92, **options)
    ours, theirs = read_bytes(tmp_path, data), np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))
    assert ours.dtype == np.uint8 and ours.shape == (*size, 3)
    assert np.abs(ours.astype(float) - theirs).mean() < JPEG_MEAN_LEVELS


@pytest.mark.parametrize("mode", ["RGB", "L", "P", "1"])
def test_opaque_png_matches_pillow_exactly(tmp_path: Path, mode: str) -> None:
    image = Image.fromarray(photo_like(13, 22)).convert(mode)
    np.testing.assert_array_equal(read_bytes(tmp_path, encoded(image, "PNG")), np.asarray(image.convert("RGB")))


@pytest.mark.parametrize("depth", [1, 2, 4])
def test_grey_png_of_few_bits_matches_pillow_exactly(tmp_path: Path, depth: int) -> None:
    rows = [np.random.default_rng(row).bytes(depth) for row in range(5)]
    data = png_of_rows(8, 5, depth, 0, rows)
    theirs = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))
    np.testing.assert_array_equal(read_bytes(tmp_path, data), theirs)


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P"])
def test_transparency_is_composited_over_black(tmp_path: Path, mode: str) -> None:
    rgba = photo_like(9, 14, 4)
    rgba[..., 3] = np.linspace(0, 255, 14).astype(np.uint8)
    image = Image.fromarray(rgba)
    if mode == "P":
        data = encoded(image.convert("RGB").quantize(16), "PNG", transparency=bytes(range(0, 256, 16)))
    else:
        data = encoded(image.convert(mode), "PNG")
    straight = np.asarray(Image.open(io.BytesIO(data)).convert("RGBA")).astype(float)
    expected = np.floor(straight[..., :3] * straight[..., 3:] / 255 + 0.5)
    np.testing.assert_array_equal(read_bytes(tmp_path, data), expected)


@pytest.mark.parametrize(("colour_type", "channels"), [(0, 1), (2, 3)])
def test_16_bit_png_is_rounded_to_8_bits(tmp_path: Path, colour_type: int, channels: int) -> None:
    samples = np.random.default_rng(1).integers(0, 65536, (6, 7, channels), dtype=np.uint16)
    samples[0, 0], samples[0, 1] = 0, 65535
    data = png_of_rows(7, 6, 16, colour_type, [row.astype(">u2").tobytes() for row in samples])
    expected = np.broadcast_to(np.floor(samples.astype(float) / 257 + 0.5), (6, 7, 3))
    np.testing.assert_array_equal(read_bytes(tmp_path, data), expected)


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_applied(tmp_path: Path, orientation: int, kind: str) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    data = encoded(Image.fromarray(photo_like(24, 40)), kind, exif=exif)
    theirs = np.asarray(ImageOps.exif_transpose(Image.open(io.BytesIO(data))).convert("RGB")).astype(float)
    ours = read_bytes(tmp_path, data)
    assert ours.shape == theirs.shape
    assert np.abs(ours - theirs).mean() < JPEG_MEAN_LEVELS
    path = tmp_path / "photo"
    assert image_size(path) == theirs.shape[:2] and is_turned(path) == (orientation > 1)
    assert read_image(path, upright=False).shape == (24, 40, 3)


@pytest.mark.parametrize(
    "tiff",
    [
        b"",
        b"II*\0",
        b"II*\0\xff\xff\xff\xff",
        b"MM\0*\0\0\0\x08\xff\xff" + b"\1" * 40,
        b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x09\0\0\0",
    ],
    ids=["empty", "no directory", "far offset", "entries missing", "orientation 9"],
)
def test_damaged_exif_leaves_the_image_as_stored(tmp_path: Path, tiff: bytes) -> None:
    pixels = photo_like(5, 8)
    data = encoded(Image.fromarray(pixels), "PNG")
    header_end = 8 + 25
    data = data[:header_end] + chunk(b"eXIf", tiff) + data[header_end:]
    np.testing.assert_array_equal(read_bytes(tmp_path, data), pixels)


def test_segments_that_steer_decoders_change_nothing(tmp_path: Path) -> None:
    plain = encoded(Image.fromarray(photo_like(32, 48)), "JPEG", subsampling=0)
    comment = b"CS=ITU601"  # makes libavcodec take the samples for limited range
    with_comment = plain[:2] + b"\xff\xfe" + struct.pack(">H", len(comment) + 2) + comment + plain[2:]
    after_end = with_comment + b"\xff\xd8 a second picture, as some phones append"
    np.testing.assert_array_equal(read_bytes(tmp_path, plain), read_bytes(tmp_path, after_end))


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
@pytest.mark.parametrize("progressive", [False, True])
def test_every_truncation_is_refused_by_name(
    tmp_path: Path, kind: str, progressive: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    options = {"progressive": progressive} if kind == "JPEG" else {}
    data = encoded(Image.fromarray(photo_like(32, 40)), kind, **options)
    for length in [*range(60), *range(60, len(data) - 1, 37), len(data) - 1]:
        refusal(tmp_path, data[:length])
        if kind == "JPEG" and length < len(data) - 40:  # the last blocks may be missed; the end marker may lie
            refusal(tmp_path, data[:length] + b"\xff\xd9")
    assert capfd.readouterr() == ("", "")


def test_flipped_bits_in_a_png_are_refused(tmp_path: Path) -> None:
    data = encoded(Image.fromarray(photo_like(32, 40)), "PNG")
    for position in range(8, len(data) - 12, 61):
        damaged = bytearray(data)
        damaged[position] ^= 0x10
        refusal(tmp_path, bytes(damaged))


@pytest.mark.parametrize(("kind", "options"), [("WEBP", {"lossless": True}), ("TIFF", {"compression": "tiff_lzw"})])
@pytest.mark.parametrize("profile", [None, "Display P3"])
def test_webp_and_tiff_show_what_the_same_photo_shows_as_png(tmp_path: Path, kind: str, options, profile) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    image = Image.fromarray(photo_like(24, 40))
    said = {"exif": exif, **({"icc_profile": icc_profile(profile)} if profile else {})}
    wanted = read_bytes(tmp_path, encoded(image, "PNG", **said))
    np.testing.assert_array_equal(read_bytes(tmp_path, encoded(image, kind, **said, **options)), wanted)
    assert image_size(tmp_path / "photo") == (40, 24)
    clear = Image.fromarray(photo_like(24, 40, 4))
    seen = (read_bytes(tmp_path, encoded(clear, one)) for one in ("PNG", "TIFF"))
    np.testing.assert_array_equal(*seen)
    data = encoded(image, kind, **options)
    for damaged in (data[:30], data[: len(data) // 2]):
        assert tells(refusal(tmp_path, damaged), "TIFF")


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP"])
def test_lenses_are_told_by_exif(tmp_path: Path, kind: str) -> None:
    said = []
    for make, focal in ((b"Canon", 24.0), (b"Canon", 35.0), (b"Sony", 35.0), (b"Sony", 35.0)):
        exif = Image.Exif()
        exif[0x010F] = make.decode()
        exif.get_ifd(0x8769).update({0x920A: focal, 0xA405: round(1.5 * focal), 0xA434: "of glass"})
        read_bytes(tmp_path, encoded(Image.fromarray(photo_like(8, 8)), kind, exif=exif))
        said.append(taken_with(exif_of(tmp_path / "photo")))
    assert len(set(said)) == 3 and said[2] == said[3] == (b"Sony", None, b"of glass", 35.0, 52, None)
    assert set(taken_with(b"II*\0\10\0\0\0\xff\xff")) == {None}


def apple_note(*rationals: int) -> bytes:
    """A maker note as iPhones write it, of a tag that nobody reads and one acceleration."""
    tags = struct.pack(">HHHIiHHII", 2, 1, 9, 1, 14, 8, 10, 3, 14 + 2 + 2 * 12 + 4)
    return b"Apple iOS\0\0\1MM" + tags + bytes(4) + struct.pack(">6i", *rationals)


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "HEIF"])
def test_a_phone_tells_which_way_things_fell(tmp_path: Path, kind: str) -> None:
    pillow_heif.register_heif_opener()
    for note, stated in (
        (apple_note(-1, 4, -9, 10, 3, 100), (-0.25, -0.9, 0.03)),
        (apple_note(1, 0, 1, 1, 1, 1), None),
        (apple_note(1, 2, 3, 4, 5, 6)[:-1], None),
        (b"Canon" + apple_note(1, 2, 3, 4, 5, 6), None),
    ):
        exif = Image.Exif()
        exif[0x010F] = "Apple"
        exif.get_ifd(0x8769)[0x927C] = note
        read_bytes(tmp_path, encoded(Image.fromarray(photo_like(64, 64)), kind, exif=exif))
        assert gravity(exif_of(tmp_path / "photo")) == stated
    assert gravity(b"II*\0\10\0\0\0\xff\xff") is None


def test_a_tiff_of_16_bits_is_rounded_and_raw_data_refused(tmp_path: Path) -> None:
    grey = photo_like(16, 24)[..., 0].astype(np.uint16) * 257
    np.testing.assert_array_equal(read_bytes(tmp_path, encoded(Image.fromarray(grey), "TIFF"))[..., 1], grey // 257)
    raw = encoded(Image.fromarray(photo_like(16, 24)), "TIFF", tiffinfo={0xC612: b"\1\4\0\0"})
    assert tells(refusal(tmp_path, raw), "DNG")


def test_foreign_files_and_kinds_are_refused_with_what_would_do(tmp_path: Path) -> None:
    image = Image.fromarray(photo_like(8, 8))
    jpeg = encoded(image, "JPEG")
    frame, scan = jpeg.index(b"\xff\xc0"), jpeg.index(b"\xff\xda")
    for data, words in (
        (encoded(image, "GIF"), "GIF JPEG PNG"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "LFS"),
        (b"\n<!DOCTYPE html><html></html>", "web page"),
        (b"", "JPEG PNG"),
        (encoded(image.convert("CMYK"), "JPEG"), "CMYK"),
        (jpeg[: frame + 1] + b"\xc9" + jpeg[frame + 2 :], "JPEG"),  # arithmetic coding
        (jpeg[: frame + 4] + b"\x0c" + jpeg[frame + 5 :], "12"),  # bits
        (jpeg[:frame] + jpeg[frame : frame + 19] + jpeg[frame:], "JPEG"),  # two frame headers
        (jpeg[:-2] + jpeg[scan : scan + 14] * 1000 + b"\xff\xd9", "JPEG"),  # each scan takes the time of a picture
    ):
        assert tells(refusal(tmp_path, data), words)
    assert read_bytes(tmp_path, jpeg[:-2] + jpeg[scan : scan + 14] * 20 + b"\xff\xd9").shape == (8, 8, 3)
    for path in (tmp_path / "missing", tmp_path):
        with refusing(InputError, str(path)):
            read_image(path)


XYZ_D50 = {  # colorants of the profiles that Apple and Adobe ship
    "Display P3": [[0.51512, 0.2412, -0.00105], [0.29198, 0.69225, 0.04189], [0.1571, 0.06657, 0.78407]],
    "Adobe RGB": [[0.60974, 0.31111, 0.01947], [0.20528, 0.62567, 0.06087], [0.14919, 0.06322, 0.74457]],
    "sRGB": [[0.43607, 0.22249, 0.01392], [0.38515, 0.71687, 0.09708], [0.14307, 0.06061, 0.7141]],
}


def icc_profile(kind: str) -> bytes:
    """A matrix profile of version 2 with a table, a gamma or a parametric curve."""

    def s15(*values: float) -> bytes:
        return struct.pack(f">{len(values)}i", *(round(65536 * value) for value in values))

    table = np.linspace(0, 1, 1024)
    light = np.where(table <= 0.04045, table / 12.92, ((table + 0.055) / 1.055) ** 2.4)
    curve = {
        "Display P3": b"para\0\0\0\0"
        + struct.pack(">HH", 3, 0)
        + s15(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045),
        "Adobe RGB": b"curv\0\0\0\0" + struct.pack(">IHxx", 1, 563),
        "sRGB": b"curv\0\0\0\0" + struct.pack(">I", 1024) + np.rint(65535 * light).astype(">u2").tobytes(),
    }[kind]
    colorants = [b"XYZ \0\0\0\0" + s15(*xyz) for xyz in XYZ_D50[kind]]
    bodies = [
        (b"wtpt", b"XYZ \0\0\0\0" + s15(0.9642, 1, 0.8249)),
        *zip((b"rXYZ", b"gXYZ", b"bXYZ"), colorants, strict=True),
    ]
    tags, at = b"", 132 + 12 * 7
    for name, body in bodies:
        tags += name + struct.pack(">II", at, len(body))
        at += len(body)
    tags += b"".join(name + struct.pack(">II", at, len(curve)) for name in (b"rTRC", b"gTRC", b"bTRC"))
    data = struct.pack(">I", 7) + tags + b"".join(body for _, body in bodies) + curve
    header = struct.pack(">I4sI4s4s4s", 128 + len(data), bytes(4), 0x02400000, b"mntr", b"RGB ", b"XYZ ") + bytes(12)
    return (header + b"acsp" + bytes(28) + s15(0.9642, 1, 0.8249)).ljust(128, b"\0") + data


@pytest.mark.parametrize("kind", ["Display P3", "Adobe RGB"])
def test_wide_gamuts_become_srgb_as_littlecms_has_it(tmp_path: Path, kind: str) -> None:
    image, profile = Image.fromarray(photo_like(48, 64)), icc_profile(kind)
    in_parts = encoded(image, "JPEG", icc_profile=profile + bytes(70_000), quality=97)
    for data, most in ((encoded(image, "PNG", icc_profile=profile), 0.1), (in_parts, 2 * JPEG_MEAN_LEVELS)):
        stored = Image.open(io.BytesIO(data)).convert("RGB")
        wide, srgb = ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
        expected = ImageCms.profileToProfile(stored, wide, srgb, ImageCms.Intent.RELATIVE_COLORIMETRIC)
        assert np.abs(np.asarray(expected).astype(int) - np.asarray(stored)).max() > 8
        assert np.abs(read_bytes(tmp_path, data).astype(int) - np.asarray(expected)).mean() < most


def test_other_ways_to_say_a_gamut(tmp_path: Path) -> None:
    image = Image.fromarray(photo_like(24, 32))
    plain, said = encoded(image, "JPEG", quality=97), b"II*\0\x08\0\0\0"
    for tag, kind, value in ((0x8769, 4, struct.pack("<I", 26)), (0xA005, 4, struct.pack("<I", 44)), (1, 2, b"R03\0")):
        said += struct.pack("<HHHI", 1, tag, kind, 4 if kind == 2 else 1) + value + bytes(4)
    exif = b"Exif\0\0" + said
    segment = b"\xff\xe1" + struct.pack(">H", 2 + len(exif)) + exif
    by_profile = read_bytes(tmp_path, encoded(image, "JPEG", quality=97, icc_profile=icc_profile("Adobe RGB")))
    assert np.abs(read_bytes(tmp_path, plain[:2] + segment + plain[2:]).astype(int) - by_profile).max() <= 1
    png, wide = encoded(image, "PNG"), encoded(image, "PNG", icc_profile=icc_profile("Display P3"))
    coded = png[:33] + chunk(b"cICP", bytes([12, 13, 0, 1])) + png[33:]
    assert np.abs(read_bytes(tmp_path, coded).astype(int) - read_bytes(tmp_path, wide)).max() <= 1


def test_profiles_that_say_srgb_or_nothing_change_nothing(tmp_path: Path) -> None:
    image = Image.fromarray(photo_like(24, 32))
    sound = icc_profile("Display P3")
    for profile in (icc_profile("sRGB"), sound[:300], sound[:-20], sound.replace(b"RGB ", b"CMYK"), b"\xff" * 200):
        np.testing.assert_array_equal(read_bytes(tmp_path, encoded(image, "PNG", icc_profile=profile)), image)
    for lead in (b"", b"\0", b"x\0\0", b"x\0\0damaged"):
        png = encoded(image, "PNG")
        np.testing.assert_array_equal(read_bytes(tmp_path, png[:33] + chunk(b"iCCP", lead) + png[33:]), image)


def test_size_is_checked_before_anything_is_decoded(tmp_path: Path) -> None:
    side = 1 << 15
    assert side * side > MAX_PIXELS
    png = png_of_rows(side, side, 8, 2, [])
    jpeg = bytearray(encoded(Image.fromarray(photo_like(8, 8)), "JPEG"))
    frame = jpeg.index(b"\xff\xc0")
    jpeg[frame + 5 : frame + 9] = struct.pack(">HH", side, side)
    tracemalloc.start()
    for data in (png, bytes(jpeg)):
        assert f"{side}x{side}" in refusal(tmp_path, data)
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()
    assert "0x5" in refusal(tmp_path, png_of_rows(0, 5, 8, 2, []))
    assert "131072x1" in refusal(tmp_path, png_of_rows(1 << 17, 1, 8, 2, []))


def test_compressed_text_is_never_inflated(tmp_path: Path) -> None:
    pixels = photo_like(4, 4)
    profile = chunk(b"iCCP", b"bomb\0\0" + zlib.compress(bytes(1 << 26), 9))
    data = png_of_rows(4, 4, 8, 2, [row.tobytes() for row in pixels], profile)
    assert len(data) < 1 << 17
    np.testing.assert_array_equal(read_bytes(tmp_path, data), pixels)


@pytest.mark.parametrize("shape", [(7, 9, 3), (7, 9), (1, 1, 3)])
def test_written_png_reads_back_exactly_in_pillow_and_here(tmp_path: Path, shape: tuple[int, ...]) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    write_png(tmp_path / "a.png", pixels)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), pixels)
    grey_as_rgb = pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, -1)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), grey_as_rgb)


def test_writer_refuses_what_is_no_image(tmp_path: Path) -> None:
    for image in (
        np.zeros((4, 4, 2)),
        np.zeros(4),
        np.zeros((0, 4, 3)),
        np.zeros((4, 4, 3), np.int64),
        np.eye(2) * np.nan,
    ):
        with pytest.raises(InputError):
            write_png(tmp_path / "a.png", image)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("size", [(48, 64), (24, 40), (100, 50), (7, 5), (61, 93), (24, 200), (122, 31)])
def test_resizing_and_stretching_equal_pillows_lanczos_on_the_same_box(size: tuple[int, int]) -> None:
    source = photo_like(61, 93)
    scale = max(size[0] / 61, size[1] / 93)
    left, top = (math.floor((side * scale - new) / 2 + 1e-9) / scale for side, new in ((93, size[1]), (61, size[0])))
    covering = (left, top, left + size[1] / scale, top + size[0] / scale)
    channels = [Image.fromarray(source[..., c].astype(np.float32)) for c in range(3)]
    for way, box in ((resize_cover, covering), (scaled, None)):
        resized = [np.asarray(c.resize(size[::-1], Image.Resampling.LANCZOS, box=box)) for c in channels]
        for image in (source, source / 255.0):
            ours = way(image, *size)
            assert ours.dtype == np.float32 and ours.flags.c_contiguous
            np.testing.assert_allclose(ours, (np.stack(resized, -1) / 255).clip(0, 1), atol=1e-5)


@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("orientation", [1, 6])
def test_a_jpeg_that_is_read_smaller_gives_the_same_small_picture(
    tmp_path: Path, orientation: int, progressive: bool
) -> None:
    photo, exif = Image.fromarray(photo_like(300, 396)), Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "a.jpg"
    path.write_bytes(encoded(photo, "JPEG", quality=95, progressive=progressive, exif=exif))
    whole = read_image(path)
    for shrink in (2, 4):
        small = read_image(path, shrink=shrink)
        assert small.shape[:2] == tuple(side // shrink for side in whole.shape[:2])
        size = whole.shape[0] // (2 * shrink), whole.shape[1] // (2 * shrink)
        error = resize_cover(small, *size, whole.shape[:2]) - resize_cover(whole, *size)
        assert np.sqrt(np.square(error).mean()) < 3 / 255
