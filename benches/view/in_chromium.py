"""How fast the page of `dtd view` is in Chromium, and what Chromium alone needs for the same videos.

Usage: python in_chromium.py URL SCENARIO      of a corpus whose SCENARIO has two videos
"""

import os
import random
import statistics
import sys

from playwright.sync_api import Browser, Page, sync_playwright

ROUNDS = 5
STEPS = 40
PLAYED_S = 6.0
# Notes the time at which all rows are there.
OPENED = """
new MutationObserver(() => {
  if (document.querySelectorAll('.gallery .card').length >= ROWS) window.opened_ms ??= performance.now();
}).observe(document, { childList: true, subtree: true });
"""
# Steps by a key; answers with the milliseconds until the next frame of the screen after the tick is shown.
STEP = """
key => new Promise(resolve => {
  const page = document.querySelector('.scenario');
  const began = performance.now();
  const observer = new MutationObserver(() => {
    observer.disconnect();
    requestAnimationFrame(() => setTimeout(() => resolve(performance.now() - began)));
  });
  observer.observe(page, { attributeFilter: ['data-tick'] });
  if (typeof key === 'number') {
    const number = document.querySelector('.transport input[type=number]');
    number.value = key;
    number.dispatchEvent(new Event('change'));
  } else {
    document.body.dispatchEvent(new KeyboardEvent('keydown', { ...key, bubbles: true }));
  }
})
"""
# Plays for a while; answers with the pictures a second of each video, and how far apart the videos were, in ticks.
WATCH = """
async ([played_s, rate]) => {
  const videos = [...document.querySelectorAll('video')];
  const shown = videos.map(() => []);
  videos.forEach((video, index) => {
    const note = (now, { mediaTime }) => {
      shown[index].push([now, Math.round(mediaTime * rate)]);
      video.requestVideoFrameCallback(note);
    };
    video.requestVideoFrameCallback(note);
  });
  const began = performance.now();
  const ticks = [];
  const page = document.querySelector('.scenario');
  if (page) new MutationObserver(() => ticks.push(page.dataset.tick)).observe(page, { attributeFilter: ['data-tick'] });
  const apart = [];
  while (performance.now() - began < played_s * 1000) {
    await new Promise(requestAnimationFrame);
    const at = shown.map(all => all.at(-1)?.[1]);
    if (at.every(Number.isFinite)) apart.push(Math.max(...at) - Math.min(...at));
  }
  const took_s = (performance.now() - began) / 1000;
  return { per_s: shown.map(all => new Set(all.map(([, tick]) => tick)).size / took_s), ticks_per_s: new Set(ticks).size / took_s,
           in_step: apart.filter(ticks => ticks <= 1).length / apart.length, same: apart.filter(ticks => ticks === 0).length / apart.length };
}
"""
BARE = """
async sources => {
  const videos = sources.map(source => {
    const video = document.createElement('video');
    Object.assign(video, { muted: true, src: source, width: 610, preload: 'auto' });
    document.body.append(video);
    return video;
  });
  await Promise.all(videos.map(video => new Promise((resolve, reject) => {
    video.addEventListener('canplay', resolve, { once: true });
    video.addEventListener('error', () => reject(Error(video.error.message)), { once: true });
  })));
}
"""
# A step of a bare video: a seek, until its picture is presented.
SEEK = """
async ([tick, rate]) => {
  const began = performance.now();
  await Promise.all([...document.querySelectorAll('video')].map(video => new Promise(resolve => {
    video.requestVideoFrameCallback(resolve);
    video.currentTime = (tick + 0.25) / rate;
  })));
  return performance.now() - began;
}
"""


def new_page(browser: Browser) -> Page:
    # Code of this script is none of the page's.
    return browser.new_context(viewport={"width": 1280, "height": 900}, bypass_csp=True).new_page()


def spread(values: list[float]) -> str:
    values = sorted(values)
    return f"best {values[0]:7.1f} ms, median {statistics.median(values):7.1f} ms, 95 % {values[int(0.95 * (len(values) - 1))]:7.1f} ms"


def measure_opening(browser: Browser, url: str) -> None:
    taken = []
    for _ in range(ROUNDS):
        page = new_page(browser)
        rows = len(page.request.get(f"{url}api/corpus").json()["scenarios"]) if not taken else rows
        page.add_init_script(OPENED.replace("ROWS", str(rows)))
        page.goto(url)
        page.wait_for_function("window.opened_ms")
        taken.append(page.evaluate("window.opened_ms"))
        page.context.close()
    print(f"open {rows} scenarios: {spread(taken)}  (goal: 1000 ms)")


def measure_steps(page: Page, ticks: int) -> None:
    back = {"key": "ArrowLeft"}
    forward = {"key": "ArrowRight"}
    far = random.Random(5).sample(range(ticks), STEPS // 2)
    for name, keys in [("forward", [forward] * STEPS), ("back", [back] * STEPS), ("anywhere", far)]:
        taken = [page.evaluate(STEP, key) for key in keys]
        print(f"step {name:8}      : {spread(taken)}  (goal: 100 ms)")


def main() -> None:
    url, scenario = sys.argv[1:]
    with sync_playwright() as playwright:
        # A container's root has no sandbox.
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        print(f"{browser.browser_type.name} {browser.version}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
        measure_opening(browser, url)

        page = new_page(browser)
        page.goto(f"{url}#scenario={scenario}&tick=1000")
        page.wait_for_selector(".scenario[data-tick='1000']")
        record = page.request.get(f"{url}api/scenario?scenario={scenario}").json()["record"]
        rate = record["frame_rate"]["numerator"] / record["frame_rate"]["denominator"]
        measure_steps(page, record["ticks"])
        page.evaluate(STEP, 1000)
        page.keyboard.press("Space")
        page.wait_for_selector("video", state="attached")
        page.wait_for_function("Number(document.querySelector('.scenario').dataset.tick) > 1010")
        ours = page.evaluate(WATCH, [PLAYED_S, rate])
        page.context.close()

        page = new_page(browser)
        page.route("**/bare", lambda route: route.fulfill(body="<!doctype html>", content_type="text/html"))
        page.goto(f"{url}bare")
        page.evaluate(BARE, [f"/video?scenario={scenario}&view={view}" for view in record["views"]])
        seeks = [page.evaluate(SEEK, [tick, rate]) for tick in range(1000, 1000 + STEPS // 2)]
        print(f"Chromium's own seeks, one tick ahead: {spread(seeks)}")
        page.evaluate("document.querySelectorAll('video').forEach(video => video.play())")
        page.wait_for_function("document.querySelector('video').currentTime > 34.5")
        bare = page.evaluate(WATCH, [PLAYED_S, rate])
        for name, found in [("dtd view", ours), ("bare videos", bare)]:
            per_s = " and ".join(f"{value:.1f}" for value in found["per_s"])
            print(f"play, {name:11}: {per_s} images/s of {rate:.0f}; the same tick in {found['same']:.0%} of the screen's frames, "
                  f"at most one apart in {found['in_step']:.0%}")
        print(f"ratio to bare videos: {min(ours['per_s']) / min(bare['per_s']):.2f}; ticks with boxes drawn: {ours['ticks_per_s']:.1f}/s")
        print(f"load {os.getloadavg()[0]:.1f}")
        browser.close()


if __name__ == "__main__":
    main()
