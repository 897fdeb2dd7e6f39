"""The page in Debian's chromium: everything is drawn, nothing is fetched, nothing sticks out, at four widths."""

import pytest
from browser import CHROMIUM, measured

WIDTHS = (320, 390, 768, 1440)

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium here")


@pytest.fixture(scope="module")
def light(report, tmp_path_factory):
    return measured(report.page, WIDTHS, tmp_path_factory.mktemp("light"))


def test_there_is_no_message_on_the_console(light):
    assert light[1] == []


@pytest.mark.parametrize("width", WIDTHS)
def test_it_renders_whole_at_every_width(width, light):
    found = light[0][str(width)]
    assert found["width"] <= width
    assert found["scroll"] <= found["width"], "nothing sticks out"
    assert found["wide"] == []
    assert len(found["boxes"]) == 6
    assert all(min(box) > 20 for box in found["boxes"]), "every figure has a size, and something in it"
    assert found["broken"] == 0
    assert found["loaded"] == []
    assert found["math"] > 5, "formulas are typeset"
    assert found["text"] > 5_000


def test_figures_are_as_wide_as_a_telephone(light):
    widths = {box[0] for box in light[0]["320"]["boxes"]}
    assert min(widths) >= 250


def test_dark_is_dark_and_the_figures_follow(report, light, tmp_path):
    found, console = measured(report.page, (390,), tmp_path, dark=True)
    assert console == []
    for part in ("ink", "lettering"):
        assert found["390"][part] == "rgb(232, 236, 241)"
        assert light[0]["390"][part] == "rgb(28, 33, 40)"
    assert found["390"]["scroll"] <= found["390"]["width"]


def test_a_broken_page_would_be_seen(report, tmp_path):
    broken = (
        report.page.replace("default-src 'none'", "default-src 'none'; img-src *", 1)
        .replace("<main>", '<main><p style="width: 60rem">wide</p><img src="x:nowhere" alt="">', 1)
        .replace('class="drawing"', 'class="drawing" style="display: none"', 1)
        .replace("<body>", "<body><script>console.error('here')</script>", 1)
    )
    found, console = measured(broken, (390,), tmp_path)
    assert found["390"]["scroll"] > 390
    assert found["390"]["wide"]
    assert min(map(min, found["390"]["boxes"])) == 0
    assert found["390"]["broken"] == 1
    assert console, "a script that the page's own rules refuse is told"
