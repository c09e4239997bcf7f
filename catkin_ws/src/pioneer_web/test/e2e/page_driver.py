"""The tests' actions on the page in the browser."""

from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

SOON = 60.0
PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
MOVE = """
const [x, y] = arguments, box = document.getElementById("map").getBoundingClientRect();
const [u, v] = fleetPage.pixel(x, y);
const at = {clientX: box.left + u, clientY: box.top + v, pointerId: 1, bubbles: true, button: 0};
const event = kind => new PointerEvent(kind, at);
document.getElementById("map").dispatchEvent(event("pointerdown"));
document.getElementById("map").dispatchEvent(event("pointerup"));
"""
OVERLAPS = """
const boxes = fleetPage.labels(), apart = (a, b) =>
  a[0] + a[2] <= b[0] || b[0] + b[2] <= a[0] || a[1] + a[3] <= b[1] || b[1] + b[3] <= a[1];
return boxes.flatMap((a, i) => boxes.slice(i + 1).filter(b => !apart(a, b)).map(b => [a, b]));
"""


def known(driver, name):
    """Returns a value of the page's state by its name in the stream, or None if no page is open."""
    return driver.execute_script(
        "return window.fleetPage ? fleetPage.state[arguments[0]] ?? null : null", name
    )


def shown(driver):
    """Returns the names of the robots that the map shows."""
    return driver.execute_script("return window.fleetPage ? fleetPage.shown() : []")


def press(driver, act):
    """Presses a button as soon as it exists."""
    button = WebDriverWait(driver, SOON).until(
        lambda _: driver.find_element(By.CSS_SELECTOR, f'[data-act="{act}"]')
    )
    driver.execute_script("arguments[0].click()", button)


def confirm(driver):
    """Presses the button of a question that does what was asked for."""
    button = WebDriverWait(driver, SOON).until(
        lambda _: driver.find_element(By.CSS_SELECTOR, 'dialog[open] button[value="yes"]')
    )
    button.click()


def send_to(driver, x, y):
    """Clicks on the map, as with a mouse or a finger."""
    press(driver, "tool-drive")
    driver.execute_script(MOVE, x, y)


def assert_fits_a_phone(driver):
    """Fails if the page is wider than a phone, a button is outside it or too low, or labels overlap."""
    width = driver.execute_script("return document.documentElement.scrollWidth")
    assert width <= PHONE["width"], f"the page is {width} pixels wide"
    for act in ("stop-all", "tool-drive", "stop"):
        box = driver.find_element(By.CSS_SELECTOR, f'[data-act="{act}"]').rect
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= PHONE["width"]
        assert box["height"] >= 24
    assert driver.execute_script(OVERLAPS) == []
