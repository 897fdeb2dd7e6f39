"""A page in a real browser, at several widths: what it shows is measured by a script in the page around it.

Each width is a frame that holds the page as it is (its own rules forbid scripts), so that media queries see that width.
"""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

SECONDS = 600
"""After which the browser is held to hang, on any machine."""

HARNESS = """<!DOCTYPE html><html><head><meta charset="utf-8"></head><body>{frames}<pre id="found"></pre><script>
const found = {{}};
function measure(frame) {{
  const page = frame.contentDocument, root = page.documentElement;
  const boxes = [...page.querySelectorAll("svg.drawing")].map(svg => {{
    const shown = svg.getBoundingClientRect(), inside = svg.getBBox();
    return [shown.width, shown.height, inside.width, inside.height];
  }});
  const wide = [...page.querySelectorAll("body *")].filter(element => {{
    if (element.closest("svg, .scroll, pre")) return false;
    return element.getBoundingClientRect().right > root.clientWidth + 0.5;
  }});
  found[frame.width] = {{
    width: root.clientWidth, scroll: root.scrollWidth, boxes: boxes,
    wide: wide.map(element => element.tagName + " " + element.textContent.slice(0, 40)),
    broken: [...page.images].filter(image => image.naturalWidth === 0).length,
    loaded: frame.contentWindow.performance.getEntriesByType("resource").map(entry => entry.name),
    math: page.querySelector("math") ? page.querySelector("math").getBoundingClientRect().width : 0,
    ink: frame.contentWindow.getComputedStyle(page.body).color,
    lettering: frame.contentWindow.getComputedStyle(page.querySelector("#figure-effort text")).fill,
    text: page.body.innerText.length,
  }};
}}
window.onload = () => {{
  for (const frame of document.querySelectorAll("iframe")) measure(frame);
  document.getElementById("found").textContent = JSON.stringify(found);
}};
</script></body></html>"""


def measured(
    page: str, widths: tuple[int, ...], place: Path, *, dark: bool = False
) -> tuple[dict, list[str]]:
    """Return what a page measures at each width, and the messages of the console."""
    frame = '<iframe width="{}" height="800" style="border:0" srcdoc="{}"></iframe>'
    frames = "".join(frame.format(width, html.escape(page, quote=True)) for width in widths)
    harness = place / "harness.html"
    harness.write_text(HARNESS.format(frames=frames), encoding="utf-8")
    done = subprocess.run(
        [
            CHROMIUM,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={place / 'profile'}",
            f"--blink-settings=preferredColorScheme={0 if dark else 1}",
            "--enable-logging=stderr",
            "--window-size=1600,900",
            "--virtual-time-budget=10000",
            "--dump-dom",
            harness.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=True,
    )
    text = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)[1]
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return json.loads(html.unescape(text)), console
