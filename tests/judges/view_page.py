"""The page of `dtd view` in Chromium: it opens with images, frames lie around the ground-truth boxes at every zoom and do not cover
them, keys step, links restore, names are text, paths have colours with a legend, nothing is wider than a phone, and axe finds nothing
inaccessible. The page keeps its own content security policy.

Usage: python view_page.py URL      of a corpus with labels, detections, a run, and a scenario folder with the name HOSTILE
"""

import io
import json
import sys
import urllib.parse
import urllib.request

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page

from browser import PHONE, SCREENS, check_access, check_width, chromium

HOSTILE = "<img src=x onerror=alert(1)>"
ZOOMS = [None, 1, 2, 4, 8, 16, 32]
# Zooms at which a frame is wider than its least width, and marks could cover a small aircraft.
SMALL_ZOOMS = [None, 1, 2]
# Distance of a frame from its box, screen pixels.
GAP = 4
# Width below which a frame does not shrink.
LEAST_FRAME = 22
LONGEST_ARM = 14
# Greenness of the line of a ground-truth box; no ground is as green.
GREEN = 70


def api(url: str, path: str, **parameters: object):
    """What the server says."""
    query = urllib.parse.urlencode(parameters)
    with urllib.request.urlopen(f"{url}{path}?{query}") as answer:
        return json.load(answer)


def shown_tick(page: Page) -> int:
    return int(page.locator(".scenario").get_attribute("data-tick"))


def wait_for_tick(page: Page, tick: int) -> None:
    page.wait_for_selector(f".scenario[data-tick='{tick}']")


def check_edge(profile: np.ndarray, expected: float, tolerance: float, what: str) -> None:
    """The line across this profile of greenness is where it should be; pixel k covers k to k + 1."""
    first = max(0, int(expected) - 4)
    near = profile[first : int(expected) + 5]
    weights = np.where(near > GREEN, near, 0)
    assert weights.sum() > 0, f"{what}: no line near {expected:.2f}"
    found = float((weights * (np.arange(len(near)) + first + 0.5)).sum() / weights.sum())
    assert abs(found - expected) <= tolerance, f"{what}: line at {found:.2f}, expected {expected:.2f}"


def check_boxes(page: Page, url: str, scenario: str, tables: dict) -> int:
    """At every zoom the corners around the ground-truth box lie within half a pixel of its edges, a gap outside. Returns the number of edges looked at."""
    edges = 0
    tick = tables["views"][0]["truth"]["tick"][0]
    for zoom in ZOOMS:
        link = {"scenario": scenario, "tick": tick, "layers": "truth", "zoom": zoom or ""}
        page.goto("about:blank")
        page.goto(f"{url}#{urllib.parse.urlencode(link)}")
        wait_for_tick(page, tick)
        page.get_by_label("Inset").uncheck()
        for index, view in enumerate(tables["views"]):
            truth = view["truth"]
            if tick not in truth["tick"]:
                continue
            row = truth["tick"].index(tick)
            cx, cy, width, height = (truth[name][row] for name in ["cx_px", "cy_px", "width_px", "height_px"])
            canvas = page.locator("canvas.picture").nth(index)
            picture = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")).astype(float)
            size_y, size_x = picture.shape[:2]
            place = canvas.bounding_box()
            # The screenshot begins at a whole pixel of the screen.
            shift_x, shift_y = place["x"] % 1, place["y"] % 1
            scale = zoom or place["width"] / view["width_px"]
            middle = (cx, cy) if zoom else ((view["width_px"] - 1) / 2, (view["height_px"] - 1) / 2)
            green = picture[:, :, 1] - np.maximum(picture[:, :, 0], picture[:, :, 2])
            centre_x = (cx - middle[0]) * scale + place["width"] / 2 + shift_x
            centre_y = (cy - middle[1]) * scale + place["height"] / 2 + shift_y
            tolerance = max(0.5 * scale, 0.5)
            half_x, half_y = (max(side / 2 * scale + GAP, LEAST_FRAME / 2) for side in (width, height))
            # The arms of a corner have a quarter of a side, at most LONGEST_ARM: these two lines cross their middles.
            column, row = (int(centre - half + min(half / 2, LONGEST_ARM) / 2) for centre, half in [(centre_x, half_x), (centre_y, half_y)])
            profiles = [
                (green[max(row, 0), :], centre_x, half_x, size_x, 0 < row),
                (green[:, max(column, 0)], centre_y, half_y, size_y, 0 < column),
            ]
            for profile, centre, half, size, is_seen in profiles:
                if half * 2 < LEAST_FRAME + 2 or not is_seen:
                    continue
                for edge in [centre - half, centre + half]:
                    if 4 < edge < size - 4:
                        check_edge(profile, edge, tolerance, f"{view['id']} at zoom {zoom}")
                        edges += 1
    return edges


def check_uncovered(page: Page, url: str, scenario: str, tables: dict) -> None:
    """With all marks, what is inside the ground-truth box looks as it does without any."""
    tick = tables["views"][0]["truth"]["tick"][0]
    compared = 0
    for zoom in SMALL_ZOOMS:
        seen = []
        for layers in ["none", "truth,detections,shifts"]:
            link = {"scenario": scenario, "tick": tick, "layers": layers, "zoom": zoom or ""}
            page.goto("about:blank")
            page.goto(f"{url}#{urllib.parse.urlencode(link)}")
            wait_for_tick(page, tick)
            page.get_by_label("Inset").uncheck()
            canvases = page.locator("canvas.picture").all()
            shots = [np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")).astype(int) for canvas in canvases]
            seen.append((shots, [canvas.bounding_box() for canvas in canvases]))
        for index, view in enumerate(tables["views"]):
            truth = view["truth"]
            if tick not in truth["tick"]:
                continue
            row = truth["tick"].index(tick)
            cx, cy, width, height = (truth[name][row] for name in ["cx_px", "cy_px", "width_px", "height_px"])
            place = seen[0][1][index]
            scale = zoom or place["width"] / view["width_px"]
            middle = (cx, cy) if zoom else ((view["width_px"] - 1) / 2, (view["height_px"] - 1) / 2)
            x = (cx - middle[0]) * scale + place["width"] / 2 + place["x"] % 1
            y = (cy - middle[1]) * scale + place["height"] / 2 + place["y"] % 1
            rows = slice(int(y - height / 2 * scale), int(y + height / 2 * scale) + 1)
            columns = slice(int(x - width / 2 * scale), int(x + width / 2 * scale) + 1)
            bare, marked = (shots[index] for shots, _ in seen)
            inside = np.abs(bare - marked)[rows, columns]
            assert inside.size and inside.max() <= 2, f"{view['id']} at zoom {zoom}: a mark covers the aircraft"
            assert np.abs(bare - marked).max() > 100, f"{view['id']} at zoom {zoom}: no mark"
            compared += 1
    assert compared >= 3, f"only {compared} images were compared"


def check_pictures(page: Page, tables: dict, scenario: str) -> None:
    """The page opens with an image of every scenario, and the paths have colours with a legend."""
    page.wait_for_function("document.querySelectorAll('.thumbnail img').length >= 5")
    loaded = "[...document.querySelectorAll('.thumbnail img')].every(image => image.complete && image.naturalWidth >= 96)"
    page.wait_for_function(loaded)
    card = page.locator(f".card[data-id='{scenario}']")
    assert tables["record"]["conditions"]["weather_name"] in card.inner_text(), card.inner_text()
    legend = page.get_by_role("list", name="Colours of the paths")
    for by, words in [("weather", "clear"), ("side", "train"), ("error", "up to")]:
        page.get_by_label("Coloured by").select_option(by)
        legend.get_by_text(words).first.wait_for()
    page.wait_for_function("location.hash.includes('colour=error')")
    page.get_by_label("Coloured by").select_option("weather")
    page.get_by_label("Sort by").select_option("-worst_pct")
    page.get_by_label("Sort by").select_option("id")


def check_play_after_jump(page: Page, url: str, scenario: str, ticks: int) -> None:
    """Playing begins at the tick that was asked for last, even if its images are still under way."""
    first = ticks - 2
    page.goto("about:blank")
    page.goto(f"{url}#{urllib.parse.urlencode({'scenario': scenario, 'tick': first, 'speed': 16})}")
    wait_for_tick(page, first)
    press = "key => document.body.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true, cancelable: true }))"
    page.evaluate(f"['Home', ' '].forEach({press})")
    page.wait_for_function(f"[document.querySelector('.scenario').dataset.tick].some(tick => 0 < tick && tick < {first})")


def check_all(page: Page, url: str) -> None:
    scenario = api(url, "api/corpus")["scenarios"]
    scenario = next(row["id"] for row in scenario if row["state"] == "detected")
    tables = api(url, "api/scenario", scenario=scenario)

    page.goto(url)
    page.get_by_role("link", name=scenario, exact=True).wait_for()
    page.get_by_text("Reading the predictions").wait_for(state="detached")
    first = page.locator(".runs tbody tr").first
    assert "recommended" in first.inner_text(), first.inner_text()
    page.get_by_label("Ticks").select_option("nm:1")
    assert "–" not in first.inner_text(), first.inner_text()
    check_pictures(page, tables, scenario)
    check_access(page, "images of all scenarios")
    check_width(page, "images of all scenarios")
    assert page.locator(".card").get_by_text(HOSTILE).count() == 1, "the hostile name is not shown"
    page.get_by_label("Show", exact=True).select_option("table")
    assert page.get_by_role("rowheader", name=HOSTILE).count() == 1, "the hostile name is not in the table"
    assert page.locator("img[src=x]").count() == 0, "the hostile name became an element"
    check_access(page, "table of all scenarios")
    check_width(page, "table of all scenarios")
    page.get_by_label("Name contains").fill(scenario)
    page.wait_for_function("location.hash.includes('text=')")
    page.reload()
    page.get_by_role("link", name=scenario, exact=True).wait_for()
    assert page.locator(".scenarios tbody tr").count() == 1, "the filter was not restored"
    page.get_by_role("link", name=scenario, exact=True).click()

    wait_for_tick(page, 0)
    check_access(page, "scenario")
    check_width(page, "scenario")
    # The run was hardly trained: its errors are large.
    clipped = "[...document.querySelectorAll('.now .scroll')].some(table => table.scrollWidth > table.clientWidth)"
    assert not page.evaluate(clipped), "a column of the predictions is clipped"
    for key, tick in [("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1), ("End", tables["record"]["ticks"] - 1), ("Home", 0)]:
        page.keyboard.press(key)
        wait_for_tick(page, tick)
    page.get_by_role("combobox", name="Speed").select_option("16")
    page.keyboard.press("Escape")
    page.get_by_role("link", name=scenario, exact=True).wait_for()
    page.go_back()
    wait_for_tick(page, 0)
    assert page.get_by_role("combobox", name="Speed").input_value() == "16"
    page.locator("main").focus()
    page.keyboard.press("Space")
    page.wait_for_function("Number(document.querySelector('.scenario').dataset.tick) >= 2")
    page.keyboard.press("Space")
    page.keyboard.press("+")
    page.keyboard.press("s")
    tick = shown_tick(page)
    page.wait_for_function("['zoom=1', 'layers=truth%2Cdetections', 'tick='].every(part => location.hash.includes(part))")
    link = page.url
    page.goto("about:blank")
    page.goto(link)
    wait_for_tick(page, tick)
    assert not page.get_by_label("Shifts").is_checked()
    assert page.get_by_role("combobox", name="Zoom").input_value() == "1"
    check_play_after_jump(page, url, scenario, tables["record"]["ticks"])
    edges = check_boxes(page, url, scenario, tables)
    assert edges >= 20, f"only {edges} edges of boxes were looked at"
    check_uncovered(page, url, scenario, tables)


def check_policy(browser: Browser, url: str) -> None:
    """Nothing on the page violates its own content security policy, which the other checks have to switch off, and views are side by side."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    faults: list[str] = []
    page.on("console", lambda message: message.type == "error" and faults.append(message.text))
    scenario = next(row["id"] for row in api(url, "api/corpus")["scenarios"] if row["state"] == "detected")
    page.goto(url)
    page.get_by_role("link", name=scenario, exact=True).click()
    wait_for_tick(page, 0)
    places = [canvas.bounding_box() for canvas in page.locator("canvas.picture").all()]
    assert len(places) == 2 and places[0]["y"] == places[1]["y"], f"the views are not side by side: {places}"
    assert not faults, faults
    context.close()


def check_on_a_phone(browser: Browser, url: str) -> None:
    """The pages fit a narrow window."""
    page = browser.new_context(viewport={"width": PHONE, "height": 800}).new_page()
    scenario = next(row["id"] for row in api(url, "api/corpus")["scenarios"] if row["state"] == "detected")
    page.goto(url)
    page.get_by_role("link", name=scenario, exact=True).wait_for()
    check_width(page, "images of all scenarios")
    page.get_by_role("link", name=scenario, exact=True).click()
    wait_for_tick(page, 0)
    check_width(page, "scenario")
    page.context.close()


def main() -> None:
    url = sys.argv[1]
    with chromium() as browser:
        check_policy(browser, url)
        check_on_a_phone(browser, url)
        for width, scheme in SCREENS:
            context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme, bypass_csp=True)
            page = context.new_page()
            faults: list[str] = []
            page.on("pageerror", lambda error, faults=faults: faults.append(str(error)))
            page.on("dialog", lambda dialog, faults=faults: faults.append(f"dialog {dialog.message}"))
            page.on("request", lambda request, faults=faults: request.url.startswith((url, "blob:", "about:")) or faults.append(request.url))
            check_all(page, url)
            assert not faults, faults
            context.close()


if __name__ == "__main__":
    main()
