"""A report in Chromium: on small and large screens, light and dark, nothing is wider than the window and axe finds nothing inaccessible.

Usage: python report_page.py REPORT.html
"""

import sys
from pathlib import Path

from browser import PHONE, SCREENS, check_access, check_width, chromium


def main() -> None:
    report = Path(sys.argv[1]).resolve()
    with chromium() as browser:
        for width, scheme in [*SCREENS, (PHONE, "light")]:
            context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
            page = context.new_page()
            page.goto(report.as_uri())
            what = f"{report.name}, {scheme}, at {width} px"
            check_access(page, what)
            check_width(page, what)
            context.close()


if __name__ == "__main__":
    main()
