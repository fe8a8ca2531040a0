"""Headless Chromium for tests of pages, driven by Selenium; nothing is downloaded."""

import importlib.util
import json
import shutil
from pathlib import Path
from typing import Any

DRIVER = "chromedriver"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
)


def _browser() -> str | None:
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


def missing_for_browser() -> str:
    """Return what is missing to drive a browser, or an empty string."""
    if importlib.util.find_spec("selenium") is None:
        return "the Python package selenium is not installed"
    if _browser() is None:
        return f"there is no {BROWSERS[0]} on the path"
    return "" if shutil.which(DRIVER) else f"there is no {DRIVER} on the path (Debian: chromium-driver)"


class Browser:
    """A browser without a window, to be closed at the end."""

    def __init__(self) -> None:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service

        browser, driver = _browser(), shutil.which(DRIVER)
        if browser is None or driver is None:
            raise RuntimeError(missing_for_browser())
        options = webdriver.ChromeOptions()
        options.binary_location = browser
        for flag in FLAGS:
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service(executable_path=driver))

    def open(self, page: Path | str, width: int = 1200, scheme: str = "light", media: str = "screen") -> None:
        """Open a page, a file or an address, `width` CSS pixels wide, light or dark, on a screen or as on paper."""
        size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width < 500}
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media, "features": features})
        self.driver.get(page if isinstance(page, str) else page.as_uri())

    def run(self, script: str, *arguments: Any) -> Any:
        """What a piece of JavaScript returns that is run in the page."""
        return self.driver.execute_script(script, *arguments)

    def press(self, *keys: str, on: Any = None) -> None:
        """Press keys, by name (`TAB`) or as text, on an element or on the one that has the focus."""
        from selenium.webdriver.common.keys import Keys

        place = self.driver.switch_to.active_element if on is None else on
        place.send_keys(*(getattr(Keys, key, key) for key in keys))

    def complaints(self) -> list[str]:
        """What the console has said of the page since this was last asked."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """Every address that was asked for since this was last asked."""
        events = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        return [event["params"]["request"]["url"] for event in events if event["method"] == "Network.requestWillBeSent"]

    def close(self) -> None:
        """End the browser and its driver."""
        self.driver.quit()
