"""Scans that are damaged or made to harm: refused with a reason, within memory and time."""

import math
import os
import signal
import struct
import threading
import time
import zipfile

import numpy as np
import pytest
from scan_files import FORMATS, plux_members, x3p_members, zipped

from gstlib.errors import InputError
from gstlib.io import bounds
from gstlib.io.bounds import bounded
from gstlib.io.scans import read_scan
from gstlib.surface import spacing_of

try:
    import resource
except ImportError:
    resource = None

SPACING = (1.66e-3, 0.83e-3)


@pytest.fixture
def heights():
    heights = 1e-3 * np.random.default_rng(1).normal(size=(5, 7))
    heights[1, 5] = math.nan
    return heights


def _read(path, sample):
    return read_scan(path, **sample.options(1e-3))


def _written(folder, name, heights, spacing=SPACING, **kwargs):
    sample = FORMATS[name]
    path = folder / f"a{sample.ending}"
    sample.write(path, heights, spacing, **kwargs)
    return path, sample


each_format = pytest.mark.parametrize("name", FORMATS)


@each_format
def test_truncated(tmp_path, heights, name):
    path, sample = _written(tmp_path, name, heights)
    content = path.read_bytes()
    for length in (0, 1, 4, 40, len(content) // 2, len(content) - 60):
        path.write_bytes(content[:length])
        if sample.ending == ".xyz" and length > 40:  # a part of a point cloud is a point cloud
            continue
        with pytest.raises(InputError, match=r"^[^:]*a\."):
            _read(path, sample)


@each_format
def test_content_of_another_format(tmp_path, heights, name):
    path, sample = _written(tmp_path, name, heights)
    content = path.read_bytes()
    text = {".csv", ".txt", ".asc", ".xyz"}
    for other in {f.ending for f in FORMATS.values()} - {sample.ending}:
        if {other, sample.ending} <= text:
            continue
        path = tmp_path / f"b{other}"
        path.write_bytes(content)
        with pytest.raises(InputError):
            read_scan(path, unit="um", spacing_mm=1e-3)


@pytest.mark.parametrize("name", [name for name, sample in FORMATS.items() if sample.claims])
@pytest.mark.parametrize("claim", [(60000, 60000), (2**31 - 1, 2**31 - 1), (5, 8), (0, 7), (-5, 7)])
def test_header_that_announces_another_shape(tmp_path, heights, name, claim):
    path, sample = _written(tmp_path, name, heights, claim=claim)
    with pytest.raises(InputError):
        _read(path, sample)


@pytest.mark.parametrize("name", ["plux", "x3p", "gwy", "gsf", "sdf text"])
def test_more_heights_than_points(tmp_path, heights, name):
    path, sample = _written(tmp_path, name, heights, claim=(5, 6))
    with pytest.raises(InputError):
        _read(path, sample)


@each_format
def test_nothing_measured(tmp_path, heights, name):
    if not FORMATS[name].unmeasured:
        pytest.skip("the format has no unmeasured points")
    path, sample = _written(tmp_path, name, np.full_like(heights, math.nan))
    with pytest.raises(InputError, match=r"not one point|no row of numbers|the file is empty"):
        _read(path, sample)


@each_format
def test_all_equal_is_flat(tmp_path, heights, name):
    path, sample = _written(tmp_path, name, np.full_like(heights, 0.001))
    scan = _read(path, sample)
    assert scan.shape == (5, 7)
    assert np.ptp(scan.values) == pytest.approx(0, abs=1e-12)


@each_format
@pytest.mark.parametrize("axis", [0, 1])
def test_single_row_or_column(tmp_path, heights, name, axis):
    line = np.nan_to_num(heights).ravel()
    path, sample = _written(tmp_path, name, line[None] if axis == 0 else line[:, None])
    with pytest.raises(InputError):
        _read(path, sample)


@each_format
@pytest.mark.parametrize("spacing", [(-1e-3, -1e-3), (0.0, 1e-3), (math.nan, 1e-3), (1e30, 1e30)])
def test_impossible_spacing(tmp_path, heights, name, spacing):
    if FORMATS[name].square:
        pytest.skip("the format has no spacing")
    path, sample = _written(tmp_path, name, heights, spacing=spacing)
    try:
        scan = _read(path, sample)
    except InputError:
        return
    # The signs of Gwyddion's sizes mean nothing, and neither does the order of points.
    assert name in ("gwy", "xyz")
    assert spacing == (-1e-3, -1e-3)
    assert spacing_of(scan) == (1e-3, 1e-3)


@each_format
def test_infinite_heights_are_unmeasured(tmp_path, heights, name):
    if name in ("sur", "vk4"):
        pytest.skip("the format stores whole numbers")
    heights[2, 3], heights[3, 2] = math.inf, -math.inf
    path, sample = _written(tmp_path, name, heights)
    scan = _read(path, sample)
    assert np.isnan(scan.values).sum() == 3
    assert np.isfinite(scan.values[0]).all()


def test_alicona_heights_in_the_header(tmp_path, heights):
    path, sample = _written(tmp_path, "al3d", heights)
    path.write_bytes(path.read_bytes().replace(b"793\0", b"100\0"))
    with pytest.raises(InputError, match="in its header"):
        _read(path, sample)


def test_sur_without_heights(tmp_path, heights):
    path, sample = _written(tmp_path, "sur", heights)
    content = bytearray(path.read_bytes())
    content[18] = 12  # a picture
    path.write_bytes(content)
    with pytest.raises(InputError, match="type 12, which is no surface"):
        _read(path, sample)


class TestArchives:
    @pytest.fixture(params=[".plux", ".x3p"])
    def archive(self, request, tmp_path, heights):
        make = {".plux": lambda h, s: plux_members([h], s), ".x3p": x3p_members}[request.param]
        return tmp_path / f"a{request.param}", make(heights, SPACING)

    def refused(self, path, match):
        with pytest.raises(InputError, match=match) as caught:
            read_scan(path)
        assert path.name in str(caught.value)

    def test_stored_and_deflated(self, archive, heights):
        path, members = archive
        for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            path.write_bytes(zipped(members, method))
            np.testing.assert_allclose(read_scan(path).values, heights, atol=1e-9)

    @pytest.mark.parametrize(
        "name", ["../../evil.xml", "/etc/evil", "a/../../evil", "C:\\evil", "..\\evil"]
    )
    def test_names_that_lead_out(self, archive, name):
        path, members = archive
        path.write_bytes(zipped(members | {name: b"evil"}))
        self.refused(path, "leads out of it")
        assert sorted(entry.name for entry in path.parent.iterdir()) == [path.name]

    def test_heights_outside(self, archive, tmp_path):
        path, members = archive
        (tmp_path / "out.raw").write_bytes(bytes(4096))
        index = next(iter(members))
        for name in (b"LAYER_0.raw", b"bindata/data.bin"):
            members[index] = members[index].replace(name, b"../out.raw")
        path.write_bytes(zipped(members))
        self.refused(path, "cannot be read")

    def test_two_members_of_one_name(self, archive):
        path, members = archive
        path.write_bytes(zipped(members))
        with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(path, "a") as file:
            file.writestr(next(iter(members)), b"<xml/>")
        self.refused(path, "two members of one name")

    def test_many_members(self, archive):
        path, members = archive
        path.write_bytes(zipped(members | {f"{n}.raw": b"" for n in range(1001)}))
        self.refused(path, "members, 1000 at most")

    def test_bomb(self, archive):
        path, members = archive
        path.write_bytes(zipped(members | {"more.xml": bytes(9 << 20)}))
        self.refused(path, "bytes of text")
        # a directory that announces 3 GiB of zeros
        content = bytearray(zipped(members | {"more.raw": bytes(1000)}))
        entry = content.rindex(b"PK\x01\x02")
        struct.pack_into("<I", content, entry + 24, 3 << 30)
        path.write_bytes(content)
        self.refused(path, "unpacks to 3221")

    def test_directory_that_understates(self, archive):
        path, members = archive
        name = next(n for n in members if n.endswith((".raw", ".bin")))
        members[name] += bytes(1 << 20)
        content = bytearray(zipped(members))
        place = content.rindex(name.encode()) - 46
        struct.pack_into("<I", content, place + 24, 5 * 7 * (4 if path.suffix == ".plux" else 8))
        path.write_bytes(content)
        self.refused(path, "Bad CRC|cannot be read")

    def test_encrypted_and_other_methods(self, archive):
        path, members = archive
        path.write_bytes(zipped(members, zipfile.ZIP_LZMA))
        self.refused(path, "packed in an unknown way")
        content = bytearray(zipped(members))
        content[content.index(b"PK\x01\x02") + 8] |= 1
        path.write_bytes(content)
        self.refused(path, "encrypted")

    @pytest.mark.parametrize(
        "declaration",
        [
            '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">'
            + "".join(
                f'<!ENTITY {new} "{10 * f"&{old};"}">'
                for old, new in zip("abcdefgh", "bcdefghi", strict=True)
            )
            + "]>",
            '<!DOCTYPE x [<!ENTITY i SYSTEM "file:///etc/hostname">]>',
        ],
    )
    def test_entities(self, archive, declaration):
        path, members = archive
        index = next(iter(members))
        content = members[index].decode()
        start = content.index("?>") + 2
        content = content[:start] + declaration + content[start:]
        members[index] = content.replace("2021-04-19", "&i;").encode()
        path.write_bytes(zipped(members))
        self.refused(path, "EntitiesForbidden")

    def test_deep_xml(self, archive):
        path, members = archive
        index = next(iter(members))
        deep = b"<a>" * 100_000 + b"</a>" * 100_000
        members[index] = members[index].replace(b"<Record2>", deep + b"<Record2>")
        members[index] = members[index].replace(b"<INFO>", deep + b"<INFO>")
        path.write_bytes(zipped(members))
        self.refused(path, "cannot be read")

    def test_damaged_heights_are_noticed(self, archive):
        path, members = archive
        content = bytearray(zipped(members, zipfile.ZIP_STORED))
        data = next(v for k, v in members.items() if k.endswith((".raw", ".bin")))
        content[content.index(data) + 9] ^= 1
        path.write_bytes(content)
        self.refused(path, "CRC")


class TestBounds:
    @pytest.mark.skipif(
        resource is None or not os.path.exists("/proc/self/statm"), reason="Linux has this bound"
    )
    def test_memory(self, tmp_path):
        before = resource.getrlimit(resource.RLIMIT_AS)
        with (
            pytest.raises(InputError, match=r"x\.plu: .* take more than 512 MiB"),
            bounded(tmp_path / "x.plu", 100),
        ):
            np.ones(80 << 20)  # 640 MiB
        assert resource.getrlimit(resource.RLIMIT_AS) == before
        with bounded(tmp_path / "x.plu", 100):
            assert np.ones(16 << 20).sum() == 16 << 20  # 128 MiB

    def test_time(self, tmp_path, monkeypatch):
        monkeypatch.setattr(bounds, "_TIME_FLOOR", 0.05)
        handler = signal.getsignal(signal.SIGALRM)

        def endless():
            while True:
                try:
                    time.sleep(0.01)
                except Exception:  # as the library's readers do
                    continue

        with (
            pytest.raises(InputError, match=r"x\.plu: .* take more than"),
            bounded(tmp_path / "x.plu", 100),
        ):
            endless()
        assert signal.getsignal(signal.SIGALRM) is handler
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)

    def test_an_alarm_of_somebody_else_goes_on(self, tmp_path):
        heard = []
        handler = signal.signal(signal.SIGALRM, lambda *_: heard.append(1))
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.2)
            with bounded(tmp_path / "x.plu", 100):
                pass
            while not heard:
                time.sleep(0.01)
        finally:
            signal.signal(signal.SIGALRM, handler)
        assert heard == [1]

    def test_in_a_thread(self, tmp_path, heights):
        path, sample = _written(tmp_path, "plu", heights)
        shapes = []
        threads = [
            threading.Thread(target=lambda: shapes.append(_read(path, sample).shape))
            for _ in range(3)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert shapes == [heights.shape] * 3

    def test_slow_to_walk_through(self, tmp_path, monkeypatch):
        """A .gwy of very many maps takes the library time squared."""
        monkeypatch.setattr(bounds, "_TIME_FLOOR", 0.2)
        monkeypatch.setattr(bounds, "_TIME_PER_BYTE", 0.0)
        one = FORMATS["gwy"]
        one.write(tmp_path / "one.gwy", np.zeros((2, 2)), SPACING)
        body = (tmp_path / "one.gwy").read_bytes()[4 + len("GwyContainer") + 1 + 4 :]
        items = b"".join(body.replace(b"/0/", b"/%d/" % n) for n in range(4000))
        path = tmp_path / "a.gwy"
        path.write_bytes(b"GWYPGwyContainer\0" + struct.pack("<I", len(items)) + items)
        with pytest.raises(InputError, match="take more than 0 s"):
            read_scan(path)
