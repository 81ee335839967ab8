"""The page in a real browser, headless Chromium: the ways through it, with real files, on a phone
and on a desk, in light and in dark, with a keyboard and without JavaScript.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import REAL
from web_pages import TOKEN, served

api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed: .ci/run installs it"
)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: .ci/run installs it"),
]
LINE = b"t [s],U [V],u_U\n0,1.02,0.1\n1,2.95,0.1\n2,5.1,0.1\n3,6.97,0.1\n4,9.02,0.1\n"
MINUTES = 120_000  # ms


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("answers")) as address:
        yield address


class Complaints(list[str]):
    """What a page wrote to the console, what failed, and what it asked from elsewhere."""

    def watch(self, page: Any, address: str) -> None:
        page.on("console", lambda message: self.append(message.text))
        page.on("pageerror", lambda error: self.append(str(error)))

        def asked(request: Any) -> None:
            if not request.url.startswith((f"http://{address}/", "data:")):
                self.append(request.url)

        page.on("request", asked)


@pytest.fixture(params=["desk", "phone"])
def page(request: pytest.FixtureRequest, chromium: Any, address: str) -> Iterator[Any]:
    """A page that has been let in; at its end nothing was complained of."""
    phone = request.param == "phone"
    context = chromium.new_context(
        viewport={"width": 390 if phone else 1280, "height": 844},
        color_scheme="dark" if phone else "light",
        has_touch=phone,
    )
    page, complaints = context.new_page(), Complaints()
    complaints.watch(page, address)
    page.goto(f"http://{address}/?token={TOKEN}")
    assert page.url == f"http://{address}/"
    yield page
    context.close()
    assert complaints == []


def wait_until(page: Any, condition: str) -> None:
    """Until a condition in JavaScript holds; the page's own policy forbids Playwright to wait."""
    end = time.monotonic() + MINUTES / 1000
    while not settled(page, lambda: page.evaluate(condition)):
        assert time.monotonic() < end, condition
        page.wait_for_timeout(50)


def settled(page: Any, ask: Callable[[], Any]) -> Any:
    """The answer of a page, asked for once more where it was just being replaced by another."""
    try:
        return ask()
    except api.Error as error:
        if "context was destroyed" not in str(error):
            raise
        page.wait_for_load_state()
        return ask()


def wait_for(page: Any, place: str) -> None:
    """Until a place is there, and the style of its page, which hides what is not asked."""
    page.wait_for_selector(place)
    page.wait_for_load_state()


def fits_the_width(page: Any) -> bool:
    page.wait_for_load_state()  # a page measured before its style has come is as wide as its images
    return bool(page.evaluate("document.documentElement.scrollWidth <= innerWidth"))


def drop(page: Any, files: dict[str, bytes]) -> None:
    """Drops files from elsewhere on the page."""
    page.evaluate(
        """(files) => {
            const data = new DataTransfer();
            for (const [name, text] of Object.entries(files)) {
                data.items.add(new File([text], name));
            }
            const about = {dataTransfer: data, bubbles: true, cancelable: true};
            document.body.dispatchEvent(new DragEvent("drop", about));
        }""",
        {name: data.decode() for name, data in files.items()},
    )


def test_a_dropped_file_becomes_a_report(page: Any) -> None:
    drop(page, {"spring.csv": LINE})
    page.wait_for_selector("h1:text('spring.csv')")
    wait_for(page, "#points")
    wait_until(page, "document.getElementById('points')?.naturalWidth > 0")
    assert fits_the_width(page)
    page.check("text=A straight line")
    assert not page.is_visible("#formula")
    page.click(".end button")
    page.wait_for_selector(".state", timeout=MINUTES)
    assert page.inner_text(".state") == "Done"
    assert fits_the_width(page)
    wait_until(page, "document.querySelector('figure img')?.naturalWidth > 0")
    with page.expect_popup() as opened:
        page.click("text=Read the report (in a new tab)")
    assert opened.value.locator("h2").first.inner_text(timeout=MINUTES)
    opened.value.close()
    assert page.inner_text(".state") == "Done"  # where the reader was
    page.click("text=Ask something else")
    assert page.is_checked("#asked-line")
    page.go_back()
    page.wait_for_selector(".state")


def test_a_real_recording_of_tracker(page: Any) -> None:
    path = REAL / "viscosity" / "CIMG9886.trk"
    if not path.exists():
        pytest.skip("the real recordings are not here")
    page.set_input_files("#files", path)
    page.wait_for_selector("h1:text('CIMG9886.trk')")
    assert "calibration stick" in page.text_content("details")
    page.select_option("#x", "t")
    page.select_option("#y", "y")
    wait_until(page, "document.getElementById('points')?.src.endsWith('points-0-2.png')")
    page.click("button:has-text('polynomial2')")
    assert page.input_value("#formula") == "c0 + c1*x + c2*x**2"
    assert page.get_attribute("button:has-text('polynomial2')", "aria-pressed") == "true"
    page.fill("#formula", "c0 + c2*x**2")
    assert page.locator("button[aria-pressed=true]").count() == 0
    page.fill("#window", "0:1")
    page.click(".end button")
    page.wait_for_selector(".state", timeout=MINUTES)
    assert "--window=0:1" in page.inner_text("pre")


def test_a_bad_formula_stands_beside_its_message_and_the_back_button_works(page: Any) -> None:
    drop(page, {"line.csv": LINE})
    wait_for(page, "#formula")
    page.fill("#formula", "a*(x + b")
    page.fill("#value", "b = 2")
    page.click(".end button")
    page.wait_for_selector("#wrong-formula", timeout=MINUTES)
    assert page.input_value("#formula") == "a*(x + b"
    assert page.input_value("#value") == "b = 2"
    wait_until(page, "document.activeElement.id === 'formula'")  # set when the page is drawn
    page.reload()
    assert page.input_value("#formula") == "a*(x + b"
    page.go_back()
    assert page.locator("h1").inner_text() == "line.csv"
    assert page.is_enabled(".end button")


def test_cancel_and_the_list_of_answers(page: Any) -> None:
    page.click("text=A cup of tea")
    page.click(".end button")
    wait_until(page, "document.getElementById('doing')?.textContent.length > 3")
    page.click("text=Cancel")
    page.wait_for_selector(".state:text('Cancelled')")
    page.click("text=Files and answers")
    page.wait_for_url("**/")
    assert "cancelled" in page.inner_text(".list")
    assert fits_the_width(page)


def test_two_tabs_have_each_their_own_answer(page: Any) -> None:
    other = page.context.new_page()
    other.goto(page.url)
    for tab, name in ((page, "one.csv"), (other, "two.csv")):
        drop(tab, {name: LINE})
        tab.wait_for_selector(f"h1:text('{name}')")
        tab.check("text=A straight line")
    for tab in (other, page):
        tab.click(".end button")
    for tab, name in ((page, "one.csv"), (other, "two.csv")):
        tab.wait_for_selector(".state", timeout=MINUTES)
        assert tab.inner_text("h1") == name


def test_a_rolling_disk_and_the_start_of_a_curve(page: Any, replica: Path) -> None:
    page.set_input_files("#files", replica / "runs" / "heavy-04.csv")
    wait_for(page, "#asked-rolling")
    page.click("button:has-text('polynomial2')")
    page.click("text=Try the formula on the points")
    page.wait_for_selector("figcaption")
    assert page.input_value("#formula") == "c0 + c1*x + c2*x**2"
    assert fits_the_width(page)
    page.check("#asked-rolling")
    assert not page.is_visible("#formula")
    page.click("summary:has-text('More about the disk')")
    assert fits_the_width(page)
    page.fill("#radius_m", "0.149(1")
    for key, text in (("phi_deg", "3.7(4)"), ("theta0_deg", "62(2)"), ("gamma", "0.19(1)")):
        page.fill(f"#{key}", text)
    page.fill("#sigma_x_m", "0.001")
    page.click(".end button")
    page.wait_for_selector("#wrong-radius_m", timeout=MINUTES)
    wait_until(page, "document.activeElement.id === 'radius_m'")
    page.fill("#radius_m", "0.149(1)")
    page.click(".end button")
    page.wait_for_selector(".state", timeout=MINUTES)
    assert page.inner_text(".state") == "Done"


def decay(size: float) -> bytes:
    rows = "".join(f"{t},{size * 2.0 ** (-t / 3) + 0.01 * (-1) ** t:.3f}\n" for t in range(10))
    return f"t [s],U [V]\n{rows}".encode()


def test_several_files_are_one_fit_or_a_table_that_a_class_fills(page: Any) -> None:
    axe = pytest.importorskip(
        "axe_playwright_python.sync_playwright", reason="axe is not installed: .ci/run installs it"
    ).Axe()

    def is_accessible() -> bool:
        found = settled(page, lambda: axe.run(page)).response["violations"]
        return [f"{each['id']}: {each['nodes'][0]['html']}" for each in found] == []

    drop(page, {"one.csv": decay(2.0), "two.csv": decay(3.0)})
    page.wait_for_selector("h1:text('one.csv, two.csv')")
    wait_until(page, "document.getElementById('points')?.naturalWidth > 0")
    assert is_accessible()
    assert fits_the_width(page)
    page.fill("#formula", "amplitude_at_the_release*exp(-t/characteristic_time_of_the_decay)")
    page.fill("#u-y", "0.01")
    assert not page.is_visible("#own")
    page.click(".end button")
    assert page.url.rpartition("/")[0].endswith("/files")  # a choice is needed
    page.check("text=All files together")
    page.fill("#own", "amplitude_at_the_release")
    page.click(".end button")
    page.wait_for_selector(".state", timeout=MINUTES)
    assert "amplitude_at_the_release[two]" in page.inner_text(".said")
    page.click("text=Ask something else")
    page.check("text=Each file by itself")
    assert not page.is_visible("#own")
    page.click(".end button")
    page.wait_for_selector("text=stop updating")
    page.click("text=Hand in a file")
    page.fill("#who", "Ana")
    assert is_accessible()
    assert fits_the_width(page)
    drop(page, {"data.csv": decay(2.5)})
    page.wait_for_selector("h1:text('Ana: data.csv')")
    page.wait_for_selector(".state", timeout=MINUTES)
    page.click("text=The table of all files")
    page.wait_for_selector("text=/2[.]5.* ± /", timeout=MINUTES)
    assert page.locator("tbody tr").count() == 3
    # no status is cut off, however long the names are
    page.wait_for_load_state()
    right = "element.getBoundingClientRect().right <= innerWidth"
    marks = f"[...document.querySelectorAll('tbody th .mark')].map((element) => {right})"
    assert page.evaluate(marks) == [True] * 3
    assert is_accessible()
    assert fits_the_width(page)


def test_files_that_are_there_are_ticked_and_put_together(chromium: Any, address: str) -> None:
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(f"http://{address}/?token={TOKEN}")
    for name in ("three.csv", "four.csv"):
        page.set_input_files("#files", {"name": name, "mimeType": "text/csv", "buffer": LINE})
        page.click("text=Look at the file")
        wait_for(page, "#formula")
        page.click("text=Files and answers")
    page.check("input[aria-label='three.csv'] >> nth=0")
    page.check("input[aria-label='four.csv'] >> nth=0")
    page.click("text=Ask about the ticked files together")
    page.wait_for_selector("h1:text('three.csv')")
    assert page.locator("input[name=files]:checked").count() == 2
    context.close()


def test_the_whole_way_by_keyboard_in_spanish(page: Any) -> None:
    page.click("text=español")
    page.focus("button:has-text('té')")
    page.keyboard.press("Enter")
    wait_for(page, "#formula")
    page.focus("#asked-formula")
    page.keyboard.press("ArrowRight")
    assert page.is_checked("#asked-rolling")
    page.keyboard.press("ArrowRight")
    assert page.is_checked("#asked-line")
    page.focus("#u-y")
    page.keyboard.type("0.3")
    page.keyboard.press("Enter")
    page.wait_for_selector(".state", timeout=MINUTES)
    assert page.get_attribute("html", "lang") == "es"


def test_the_way_without_javascript(chromium: Any, address: str) -> None:
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(f"http://{address}/?token={TOKEN}")
    page.set_input_files("#files", {"name": "a.csv", "mimeType": "text/csv", "buffer": LINE})
    page.click("text=Look at the file")
    page.click("button:has-text('line') >> nth=0")
    page.click("text=Try the formula on the points")
    assert "slope = " in page.inner_text("figcaption")
    assert page.input_value("#formula") == "slope*x + intercept"
    page.click(".end button")
    page.wait_for_selector(".state", timeout=MINUTES)
    context.close()


def test_no_serious_finding_of_accessibility(page: Any) -> None:
    axe = pytest.importorskip(
        "axe_playwright_python.sync_playwright", reason="axe is not installed: .ci/run installs it"
    ).Axe()

    def findings() -> list[str]:
        found = settled(page, lambda: axe.run(page)).response["violations"]
        return [f"{each['id']}: {each['nodes'][0]['html']}" for each in found]

    assert findings() == []
    page.goto(page.url + "propagate")
    assert findings() == []
    page.go_back()
    drop(page, {"line.csv": LINE})
    wait_for(page, "#formula")
    for kind in ("#asked-formula", "#asked-rolling"):
        page.check(kind)
        closed = page.locator("details:not([open]) > summary:visible")
        while closed.count():
            closed.first.click()
        assert findings() == []
    page.check("text=A straight line")
    page.click(".end button")
    page.wait_for_selector("#progress")
    assert findings() == []
    page.wait_for_selector(".state", timeout=MINUTES)
    assert findings() == []


def test_a_report_runs_no_script_and_reaches_no_page(page: Any, address: str) -> None:
    """The report is in a sandbox, and so it is as a page of its own."""
    drop(page, {"<img src=x onerror=alert(1)>.csv": LINE})
    wait_for(page, "#asked-line")
    page.check("text=A straight line")
    page.click(".end button")
    page.wait_for_selector(".state", timeout=MINUTES)
    with page.expect_popup() as opened:
        page.click("text=Read the report")
    wait_until(opened.value, "self.origin === 'null'")
    assert "cookie" in opened.value.evaluate(
        "(() => { try { document.cookie } catch (e) { return '' + e } })()"
    )


def test_nothing_moves_while_a_page_is_loaded(chromium: Any, address: str, tmp_path: Path) -> None:
    context = chromium.new_context(viewport={"width": 390, "height": 844})
    page = context.new_page()
    page.add_init_script(
        "self.moved = 0; new PerformanceObserver((list) => { for (const entry of list.getEntries())"
        " self.moved += entry.value; }).observe({type: 'layout-shift', buffered: true})"
    )
    page.goto(f"http://{address}/?token={TOKEN}")
    page.click("text=A cup of tea")
    wait_for(page, "#points")
    wait_until(page, "document.getElementById('points')?.naturalWidth > 0")
    assert page.evaluate("self.moved") < 0.01
    context.close()
