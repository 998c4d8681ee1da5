"""The page of a comparison: whole, on its own, the same every time, and opened by a real browser without complaint."""

from __future__ import annotations

import base64
import html
import io
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import geomphys
from geomphys.analysis.diff.html_report import write_page
from tests.made import Results

VOID = {"meta", "link", "img"}


class Page(HTMLParser):
    """Checks that elements are closed in order, and gathers what the page refers to and what it says."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href", "action", "data"}]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def page(landed: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a hand on a table and on the raised one."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_page(geomphys.compare_outputs(landed.out, landed.raised), path)
    return path


def test_a_page_needs_nothing_but_itself(page: Path) -> None:
    text = page.read_text()
    content = Page(text)
    assert content.addresses
    assert all(address.startswith("data:") for address in content.addresses)
    assert not re.search(r"https?://|@import|url\(|<script", text)
    assert content.tags.count("svg") >= 2
    assert content.tags.count("img") >= 2
    for word in ("Different", "palm", "table", "world_sha256", "/contacts", "hand/index_distal"):
        assert word in content.text


def test_its_pictures_show_both_motions(page: Path) -> None:
    for data in re.findall(r'src="data:image/png;base64,([^"]+)"', page.read_text())[:2]:
        pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)
        blue = (pixels[..., 2] > pixels[..., 0] + 25).mean()
        orange = (pixels[..., 0] > pixels[..., 2] + 12).mean()
        assert blue > 0.0005  # little of it is seen in the close-up
        assert orange > 0.002


def test_the_same_comparison_gives_the_same_page(page: Path, landed: Results, tmp_path: Path) -> None:
    again = tmp_path / "again.html"
    write_page(geomphys.compare_outputs(landed.out, landed.raised), again)
    assert again.read_bytes() == page.read_bytes()


def test_equal_outputs_have_a_page_too(pressed: Results, tmp_path: Path) -> None:
    write_page(geomphys.compare_outputs(pressed.out, pressed.out), tmp_path / "same.html")
    content = Page((tmp_path / "same.html").read_text())
    assert "The same" in content.text
    assert "img" not in content.tags


def test_names_from_files_are_no_markup(pressed: Results, tmp_path: Path) -> None:
    evil = tmp_path / "<b>&evil.mcap"
    evil.write_bytes(pressed.raised.read_bytes())
    write_page(geomphys.compare_outputs(evil, pressed.out), tmp_path / "page.html")
    content = Page((tmp_path / "page.html").read_text())
    assert "<b>&evil.mcap" in content.text
    assert "b" not in content.tags


def test_without_the_meshes_the_page_says_so(landed: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geomphys.output.output_world.write_attachments", lambda files, folder: {})
    write_page(geomphys.compare_outputs(landed.out, landed.raised), tmp_path / "page.html")
    content = Page((tmp_path / "page.html").read_text())
    assert "No pictures" in content.text
    assert "img" not in content.tags


def test_what_only_one_has_and_what_the_scenes_differ_in_is_said(
    pressed: Results, landed: Results, page: Path, tmp_path: Path
) -> None:
    assert "object table: position is [2, 1.5, 0] in a, [2, 1.5, 0.001] in b, 1 mm apart" in Page(page.read_text()).text
    write_page(geomphys.compare_outputs(pressed.out, landed.out), tmp_path / "page.html")
    text = Page((tmp_path / "page.html").read_text()).text
    for words in (
        "Only in a",
        "bodies: finger",
        "Only in b",
        "object finger: only in a",
        "avatar hand: only in b",
    ):
        assert words in text


@pytest.fixture(scope="module")
def browser() -> str:
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        pytest.skip("no chromium here (Debian and Ubuntu: apt-get install chromium)")
    return found


def test_on_a_telephone_nothing_is_wider_than_the_page(page: Path, browser: str, tmp_path: Path) -> None:
    frame = tmp_path / "frame.html"
    script = (
        "onload = () => { const page = document.querySelector('iframe').contentDocument; "
        "document.title = [page.documentElement.scrollWidth, page.documentElement.clientWidth, "
        "Math.max(...[...page.querySelectorAll('*')].map(e => Math.ceil(e.getBoundingClientRect().right)))].join(' '); }"
    )
    inner = html.escape(page.read_text(), quote=True)
    frame.write_text(
        f'<!doctype html><iframe srcdoc="{inner}" style="width:360px;height:800px;border:0"></iframe><script>{script}</script>'
    )
    words = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    found = subprocess.run(
        [*words, "--dump-dom", frame.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    width, shown, rightmost = map(int, re.findall(r"<title>(\d+) (\d+) (\d+)</title>", found.stdout)[0])
    assert width == shown <= 360
    assert rightmost <= 360


def test_a_browser_opens_it_without_complaint(page: Path, browser: str, tmp_path: Path) -> None:
    picture = tmp_path / "page.png"
    words = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--v=0"]
    words += [
        f"--user-data-dir={tmp_path / 'profile'}",
        "--window-size=1000,1600",
        f"--screenshot={picture}",
        page.as_uri(),
    ]
    outcome = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert outcome.returncode == 0, outcome.stderr
    assert "CONSOLE" not in outcome.stderr
    pixels = np.asarray(Image.open(picture).convert("RGB"))
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 100
