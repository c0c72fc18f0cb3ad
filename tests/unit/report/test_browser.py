"""The report in a real browser: it opens from a file, plays, tells values, sorts, can be read, and fits a phone."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from ohmloom.mapping import Hardware
from ohmloom.neurocontroller import Network
from ohmloom.report import write_report
from ohmloom.report._page_maps import device_rows, device_values
from ohmloom.report._page_run import die_run
from ohmloom.sim import Arena, Feasibility, feasibility

COMMAND = "ohmloom evaluate net.json --hardware het_mixed --dies 3 --seed 1"
HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>"
WIDE, PHONE = {"width": 1180, "height": 900}, {"width": 390, "height": 844}
LEAST_CONTRAST = 4.5  # WCAG 2.2, 1.4.3, for text of ordinary size

CONTRASTS = """() => {
  const channels = (colour) => (colour.match(/[\\d.]+/g) || []).map(Number);
  const luminance = (rgb) => rgb.slice(0, 3).map((v) => v / 255)
    .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + [0.2126, 0.7152, 0.0722][i] * v, 0);
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const [r, g, b, alpha = 1] = channels(getComputedStyle(at).backgroundColor);
      if (alpha === 1) return [r, g, b];
    }
    return channels(getComputedStyle(document.documentElement).getPropertyValue("--paper"));
  };
  const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.textContent.trim() || ["SCRIPT", "NOSCRIPT", "STYLE"].includes(element.tagName)) continue;
    if (!element.checkVisibility({ opacityProperty: true })) continue;
    const style = getComputedStyle(element), isSvg = element.closest("svg") !== null;
    // Delays stand on the colour of their device; a test of the pictures looks at these.
    if (isSvg && /^\\d+$/.test(element.textContent.trim()) && element.closest("svg[data-map]")) continue;
    const [r, g, b] = channels(isSvg ? style.fill : style.color);
    const one = luminance([r, g, b]), other = luminance(behind(element));
    const ratio = (Math.max(one, other) + 0.05) / (Math.min(one, other) + 0.05);
    found.push([ratio, element.textContent.trim().slice(0, 60), style.color, element.tagName]);
  }
  return found;
}"""


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    path = shutil.which("chromium")
    if path is None:
        if os.environ.get("OHMLOOM_REQUIRE_TOOLS"):
            pytest.fail("chromium is not on PATH, and OHMLOOM_REQUIRE_TOOLS is set")
        pytest.skip("chromium is not on PATH: opens the report as a person does")
    with sync_playwright() as driver:
        # Root, as on a build machine, has no sandbox; the pages are our own.
        found = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield found
        found.close()


Opened = Callable[..., Page]


@pytest.fixture
def opened(browser: Browser) -> Iterator[Opened]:
    """Opens a file: viewport=WIDE, scheme="light"; whatever the console or the page says is an error."""
    contexts = []

    def open_file(path: Path, *, viewport: Any = WIDE, scheme: Any = "light") -> Page:
        context = browser.new_context(viewport=viewport, color_scheme=scheme, offline=True)
        contexts.append(context)
        page = context.new_page()
        context.said = []  # type: ignore[attr-defined]
        page.on("console", lambda message: context.said.append(message.text))  # type: ignore[attr-defined]
        page.on("pageerror", lambda error: context.said.append(str(error)))  # type: ignore[attr-defined]
        page.on("dialog", lambda dialog: (context.said.append(dialog.message), dialog.dismiss()))  # type: ignore[attr-defined]
        page.goto(path.as_uri())
        if 'id="player"' in path.read_text(encoding="utf-8"):
            page.locator("html.plays").wait_for(state="attached")  # its numbers are inflated by then
        return page

    yield open_file
    for context in contexts:
        said = context.said
        context.close()
        assert said == []


@pytest.fixture(scope="module")
def het_file(het_study: Feasibility, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(het_study, path, command=COMMAND)
    return path


@pytest.fixture(scope="module")
def loaded_file(het_study: Feasibility, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("loaded")
    het_study.save(folder / "report.json")
    write_report(Feasibility.load(folder / "report.json"), folder / "report.html", command=COMMAND)
    return folder / "report.html"


def now(page: Page, side: int) -> str:
    return page.locator(f"#side-{side} [data-part=status]").inner_text()


def pixels(page: Page, selector: str) -> Any:
    return page.locator(selector).evaluate("canvas => canvas.toDataURL()")


@pytest.mark.parametrize("which", ["het_file", "loaded_file"])
def test_page_opens_from_a_file_without_a_word_on_the_console(
    opened: Opened, which: str, request: pytest.FixtureRequest
) -> None:
    page = opened(request.getfixturevalue(which))
    assert page.locator("h2").first.inner_text().startswith("Verdict:")
    assert page.locator("#tip").is_hidden()


def test_replay_plays_both_sides_to_the_end_and_stops(opened: Opened, het_file: Path, het_study: Feasibility) -> None:
    page = opened(het_file)
    assert het_study.agreement is not None
    assert het_study.hardware_trial is not None
    before = [pixels(page, f"#side-{k} [data-part=arena]") for k in (0, 1)]
    page.get_by_role("group", name="Replay").get_by_label("speed").select_option("16")
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="Pause").wait_for()
    page.get_by_role("button", name="Play").wait_for(timeout=30_000)
    for k, trial in enumerate((het_study.agreement.trial, het_study.hardware_trial)):
        executed = len(trial.actions)
        assert now(page, k) == f"timestep {executed}/{executed}, counted {trial.timesteps}: end"
        assert pixels(page, f"#side-{k} [data-part=arena]") != before[k]


def test_replay_is_drawn_before_anybody_touches_it(opened: Opened, het_file: Path) -> None:
    page = opened(het_file)
    # Most colours along a line right of the labels and the cursor: some neuron's spikes come and go in a trial.
    colours = page.evaluate("""() => {
      const canvas = document.querySelector("#side-0 [data-part=raster]"), g = canvas.getContext("2d");
      const width = canvas.width - 100, height = canvas.height - 20;
      const pixels = new Uint32Array(g.getImageData(100, 0, width, height).data.buffer);
      const along = (_, y) => new Set(pixels.subarray(y * width, (y + 1) * width)).size;
      return Math.max(...Array.from({ length: height }, along));
    }""")
    assert colours > 1


def test_replay_scrubs_by_mouse(opened: Opened, het_file: Path) -> None:
    page = opened(het_file)
    slider = page.locator("#player [data-part=slider]")
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    assert box is not None
    weights = [pixels(page, f"#side-{k} [data-part=weights]") for k in (0, 1)]
    page.mouse.move(box["x"] + 8, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, steps=4)
    page.mouse.up()
    at = int(slider.input_value())
    assert 60 < at < 200
    for k in (0, 1):
        assert now(page, k).startswith(f"timestep {at}/")
        assert pixels(page, f"#side-{k} [data-part=weights]") != weights[k]
    raster = page.locator("#side-1 [data-part=raster]")
    raster.click(position={"x": 90, "y": 20})
    assert int(slider.input_value()) < at
    assert "of 21" in page.locator("#side-1 [data-part=raster-note]").inner_text()


def test_replay_scrubs_by_keyboard_without_moving_the_page(opened: Opened, het_file: Path) -> None:
    page = opened(het_file)
    page.locator("#player").focus()
    top = page.evaluate("window.scrollY")
    for key, wanted in (("ArrowRight", 1), ("Shift+ArrowRight", 11), ("ArrowLeft", 10), ("Home", 0)):
        page.keyboard.press(key)
        assert now(page, 0).startswith(f"timestep {wanted}/")
        assert now(page, 1).startswith(f"timestep {wanted}/")
    page.keyboard.press("Space")
    page.get_by_role("button", name="Pause").wait_for()
    page.keyboard.press("Space")
    page.get_by_role("button", name="Play").wait_for()
    page.keyboard.press("End")
    assert ": end" in now(page, 0)
    assert page.evaluate("window.scrollY") == top


def test_keys_outside_the_replay_leave_it_alone(opened: Opened, het_file: Path) -> None:
    page = opened(het_file)
    page.locator("nav a").first.focus()
    page.keyboard.press("End")
    page.keyboard.press("ArrowRight")
    assert now(page, 0).startswith("timestep 0/")


def test_pointer_on_a_device_shows_its_values(opened: Opened, het_file: Path, het_study: Feasibility) -> None:
    page, plan = opened(het_file), het_study.plan
    assert plan is not None
    known = device_values(het_study, die_run(het_study))
    assert known is not None
    rows = device_rows(plan, known)
    tip = page.locator("#tip")
    svg = page.locator("svg[data-map='0']").first
    svg.scroll_into_view_if_needed()
    x0, y0, dx, dy = (float(v) for v in (svg.get_attribute("data-frame") or "").split())
    points = [point for point in plan.crosspoints if point.tile == 0]
    for point in (points[0], points[-1]):
        at = svg.evaluate(
            "(svg, [x, y]) => { const p = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM()); return [p.x, p.y]; }",
            [x0 + dx * point.column, y0 + dy * point.row],
        )
        page.mouse.move(*at)
        shown = tip.inner_text()
        for name, value in rows[point.synapse].items():
            assert value in shown
            assert name == "synapse" or name in shown
        # The mark lies on the very square that matplotlib drew for a device, and covers its middle.
        squares = svg.locator("[id$='devices'] path").evaluate_all(
            "paths => paths.map(p => p.getBoundingClientRect()).map(b => [b.x + b.width / 2, b.y + b.height / 2])"
        )
        nearest = min(np.hypot(x - at[0], y - at[1]) for x, y in squares)
        assert nearest < 1.0  # CSS pixels, of some 20 between lines
    page.mouse.move(2, 2)
    assert tip.is_hidden()


def test_crossbar_is_read_by_keyboard_too(opened: Opened, het_file: Path) -> None:
    page = opened(het_file)
    page.locator("svg[data-map='0']").first.focus()
    tip = page.locator("#tip")
    seen = set()
    page.keyboard.press("ArrowDown")
    for key in ("ArrowRight", "ArrowRight", "ArrowDown", "ArrowDown"):
        page.keyboard.press(key)
        assert tip.is_visible()
        seen.add(
            page.locator("rect.marker").evaluate("mark => [mark.getAttribute('x'), mark.getAttribute('y')].join()")
        )
    assert len(seen) == 4
    page.keyboard.press("Escape")
    assert tip.is_hidden()


@pytest.mark.parametrize("viewport", [WIDE, PHONE])
def test_figures_sort_by_mouse_and_by_keyboard(
    opened: Opened, het_file: Path, het_study: Feasibility, viewport: Any
) -> None:
    page = opened(het_file, viewport=viewport)

    def names() -> list[str]:
        return page.locator("table.figures tbody th code").all_inner_texts()

    assert names() == [figure.name for figure in het_study.figures]
    margins = {figure.name: figure.margin for figure in het_study.figures}
    button = page.locator("table.figures thead button", has_text="margin")
    button.click()
    known = [margins[name] for name in names() if margins[name] is not None]
    assert known == sorted(known)
    assert [margins[name] is None for name in names()] == sorted(margins[name] is None for name in names())
    button.focus()
    page.keyboard.press("Enter")
    known = [margins[name] for name in names() if margins[name] is not None]
    assert known == sorted(known, reverse=True)
    assert page.locator("table.figures th[aria-sort]").get_attribute("aria-sort") == "descending"
    # Each figure keeps the row of words below it.
    details = {figure.name: " ".join(figure.detail.split()) for figure in het_study.figures}
    for group in page.locator("table.figures tbody").all():
        assert details[group.locator("th code").inner_text()] in " ".join(group.inner_text().split())


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("viewport", [WIDE, PHONE])
def test_all_text_stands_out_from_what_is_behind_it(opened: Opened, het_file: Path, scheme: str, viewport: Any) -> None:
    page = opened(het_file, scheme=scheme, viewport=viewport)
    svg = page.locator("svg[data-map='0']").first
    svg.focus()
    page.keyboard.press("ArrowDown")
    found = page.evaluate(CONTRASTS)
    assert len(found) > 300
    assert [one for one in found if one[0] < LEAST_CONTRAST] == []


@pytest.mark.parametrize("which", ["het_file", "loaded_file"])
def test_page_fits_a_phone(opened: Opened, which: str, request: pytest.FixtureRequest) -> None:
    page = opened(request.getfixturevalue(which), viewport=PHONE)
    assert page.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
    sideways = page.evaluate(
        "() => [...document.querySelectorAll('main *')].filter(e => !e.closest('.picture') && "
        "e.getBoundingClientRect().right > innerWidth + 0.5).map(e => e.outerHTML.slice(0, 80))"
    )
    assert sideways == []


def test_hostile_names_are_text_and_run_nothing(opened: Opened, tmp_path: Path) -> None:
    network = Network.random(system="HP", rng=np.random.default_rng(1)).replace(name=HOSTILE)
    study = feasibility(network, Hardware.load("hp_1t1r"), dies=1, arena=Arena.paper().replace(max_timesteps=60))
    write_report(study, tmp_path / "report.html", command=HOSTILE)
    page = opened(tmp_path / "report.html")
    assert page.locator("h1").inner_text() == f"{HOSTILE} on hp_1t1r"
    assert page.locator("#reproduce pre").inner_text() == HOSTILE
    assert page.title().startswith(HOSTILE)


def test_a_script_that_is_not_the_reports_own_is_not_run(opened: Opened, het_file: Path, tmp_path: Path) -> None:
    text = het_file.read_text(encoding="utf-8").replace("</main>", "</main><script>window.ran = true</script>")
    (tmp_path / "report.html").write_text(text, encoding="utf-8")
    page = opened(tmp_path / "report.html")
    assert page.evaluate("window.ran") is None
    said = page.context.said  # type: ignore[attr-defined]
    assert len(said) == 1
    assert "Content Security Policy" in said.pop()


def test_printed_page_has_the_paths_and_no_controls(opened: Opened, het_file: Path) -> None:
    page = opened(het_file)
    assert page.locator(".paths").is_hidden()
    page.emulate_media(media="print")
    assert page.locator(".paths svg").first.is_visible()
    assert page.locator("#player").is_hidden()
    assert page.locator("nav").is_hidden()
