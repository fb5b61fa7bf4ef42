"""What mouse, touch and keys tell the page's mover: events in, calls out."""

from __future__ import annotations

from typing import Any

import pytest
from page.scripts import run as run_with

START = """
import { Controls } from "./controls.js";
const told = [], listeners = {}, round = (values) => values.map((x) => (typeof x === "number" ?
  Number(x.toFixed(9)) : x));
const tell = (name) => (...given) => { told.push([name, ...round(given.flat())]); };
const canvas = {
  addEventListener: (name, react, options) => { listeners[name] = [react, options]; },
  setPointerCapture: tell("capture"),
};
const mover = Object.fromEntries(["turn", "slide", "near", "keys"].map((name) => [name, tell(name)]));
const controls = new Controls(canvas, {
  mover: () => mover, moved: tell("moved"), back: tell("back"), picked: tell("picked"), touched: tell("touched"),
  point: (x, y) => { tell("point")(x, y); return [x, y, 7]; },
});
// An event, and what was told because of it.
function send(type, more = {}) {
  let isPrevented = false;
  const event = { type, pointerId: 1, buttons: 1, pointerType: "mouse", timeStamp: 0, preventDefault: () => {
    isPrevented = true; }, ...more };
  listeners[type][0](event);
  return [...told.splice(0), ...(isPrevented ? ["prevented"] : [])];
}
const at = (clientX, clientY, more) => ({ clientX, clientY, offsetX: clientX - 1, offsetY: clientY - 2, ...more });
"""


def run(code: str) -> Any:
    return run_with(code, START)


def test_a_drag_turns_by_what_it_moves() -> None:
    assert run(
        """
        return [send("pointermove", at(9, 9)), send("pointerdown", at(10, 20)), controls.isMoving,
          send("pointermove", at(13, 15)),
          send("pointermove", at(14, 18)), send("pointerup", at(14, 18)), controls.isMoving, send("pointermove",
            at(1, 1))];
        """
    ) == [
        [], [["touched"], ["capture", 1]], True, [["turn", 3, -5], ["moved"]], [["turn", 1, 3], ["moved"]], [["moved"]],
        False, [],
    ]  # fmt: skip


def test_other_buttons_and_shift_slide() -> None:
    found = run(
        """
        return [{ buttons: 1 }, { buttons: 2 }, { buttons: 4 }, { buttons: 3 }, { shiftKey: true }].map((held) => {
          send("pointerdown", at(0, 0));
          return send("pointermove", at(3, 4, held));
        });
        """
    )
    assert found == [[[way, 3, 4], ["moved"]] for way in ("turn", "slide", "slide", "slide", "slide")]


def test_two_fingers_slide_and_pinch_about_what_showed_between_them() -> None:
    found = run(
        """
        const finger = (pointerId, x, y) => at(x, y, { pointerId, pointerType: "touch", timeStamp: 1000 * x });
        send("pointerdown", finger(1, 100, 100));
        send("pointerdown", finger(2, 130, 140));
        return [send("pointermove", finger(2, 160, 180)), send("pointermove", finger(1, 110, 94)),
          send("pointermove", finger(2, 160, 260)),
          send("pointermove", finger(2, 110, 94)), send("pointerup", finger(2, 160, 260)), send("pointermove",
            finger(1, 111, 94)),
          send("pointercancel", finger(1, 111, 94)), controls.isMoving];
        """
    )
    assert found[0] == [["slide", 15, 20], ["point", 130, 140], ["near", 2, 130, 140, 130, 140, 7], ["moved"]]
    factor = pytest.approx((50**2 + 86**2) ** 0.5 / 100, abs=1e-8)
    near = ["near", factor, 135, 137, 130, 140, 7]
    assert found[1] == [["slide", 5, -3], near, ["moved"]]
    assert [one[0] for one in found[2]] == ["slide", "point", "near", "moved"] and found[2][1] == ["point", 135, 177]
    assert found[3][2][1] == pytest.approx(1 / (50**2 + 166**2) ** 0.5, rel=1e-6)
    assert found[4:] == [[["moved"]], [["turn", 1, 0], ["moved"]], [["moved"]], False]


def test_the_wheel_approaches_what_it_began_on() -> None:
    found = run(
        """
        const wheel = (deltaY, x, timeStamp, deltaMode = 0) => send("wheel", { deltaY, deltaMode, offsetX: x,
          offsetY: 50, timeStamp });
        return [wheel(100, 40, 600), wheel(-200, 60, 1000), wheel(3, 64, 1500), wheel(2, 65, 1600, 1), wheel(1, 65,
          2101, 2),
          wheel(900, 66, 2200), wheel(-900, 66, 2300), listeners.wheel[1]];
        """
    )
    e = 2.718281828459045
    wanted = [
        (-0.1, 40, 40),
        (0.2, 60, None),
        (-0.003, 64, None),
        (-0.032, 65, 65),
        (-0.1, 65, 65),
        (-0.25, 66, None),
        (0.25, 66, None),
    ]
    anchor = 40
    for events, (log, x, point) in zip(found[:-1], wanted, strict=True):
        points = [one for one in events if one[0] == "point"]
        assert points == ([["point", point, 50]] if point else [])
        anchor = point or anchor
        near = ["near", pytest.approx(e**log, abs=1e-8), x, 50, anchor, 50, 7]
        assert [one for one in events if one not in points] == [["touched"], near, ["moved"], "prevented"]
    assert found[-1] == {"passive": False}


KEYS = {
    "KeyA": [-1, 0, 0, 0, 0], "KeyD": [1, 0, 0, 0, 0], "KeyQ": [0, 1, 0, 0, 0], "KeyE": [0, -1, 0, 0, 0],
    "KeyW": [0, 0, 1, 0, 0], "KeyS": [0, 0, -1, 0, 0], "ArrowLeft": [0, 0, 0, -1, 0], "ArrowRight": [0, 0, 0, 1, 0],
    "ArrowUp": [0, 0, 0, 0, -1], "ArrowDown": [0, 0, 0, 0, 1], "Equal": [0, 0, 1, 0, 0], "NumpadAdd": [0, 0, 1, 0, 0],
    "Minus": [0, 0, -1, 0, 0], "NumpadSubtract": [0, 0, -1, 0, 0],
}  # fmt: skip


def test_held_keys_move_until_they_are_let_go() -> None:
    found = run(
        f"""
        return {list(KEYS)}.map((code) => {{
          const down = send("keydown", {{ code, shiftKey: false }}), isMoving = controls.isMoving;
          controls.step(0.25);
          const moved = told.splice(0);
          send("keyup", {{ code }});
          controls.step(0.25);
          return [down, isMoving, moved, controls.isMoving, told.splice(0)];
        }});
        """
    )
    for (_, ways), answer in zip(KEYS.items(), found, strict=True):
        down = [["touched"], ["moved"], "prevented"]
        assert answer == [down, True, [["keys", *ways, 0.25, False], ["moved"]], False, []]


def test_keys_add_up_shift_hurries_and_losing_the_focus_stops() -> None:
    assert run(
        """
        for (const code of ["KeyW", "KeyD", "Equal"]) send("keydown", { code, shiftKey: true });
        controls.step(0.5);
        const moved = told.splice(0);
        send("blur");
        controls.step(0.5);
        return [moved, told, controls.isMoving];
        """
    ) == [[["keys", 1, 0, 2, 0, 0, 0.5, True], ["moved"]], [], False]


def test_keys_that_return_and_keys_that_are_the_browser_s() -> None:
    found = run(
        """
        return [...["Home", "Escape", "Digit0", "KeyX"].map((code) => send("keydown", { code })),
          ...["ctrlKey", "metaKey", "altKey"].map((name) => send("keydown", { code: "KeyW", [name]: true })),
          send("contextmenu"), send("dblclick", at(31, 42))];
        """
    )
    assert found == [[["back"]]] * 3 + [[]] * 4 + [["prevented"], [["picked", 30, 40]]]


def test_two_taps_at_one_place_pick() -> None:
    cases = [  # pressed at, released after, x, y
        ([(0, 349, 10, 10), (350, 348, 20, 10)], True),
        ([(0, 350, 10, 10), (400, 10, 10, 10)], False),  # the first was held
        ([(0, 10, 10, 10), (1, 358, 10, 10)], False),  # the second was
        ([(0, 10, 10, 10), (355, 5, 10, 10)], False),  # too late
        ([(0, 10, 10, 10), (354, 5, 10, 10)], True),
        ([(0, 10, 10, 10), (100, 10, 27, 27)], False),  # elsewhere: 24.04 away
        ([(0, 10, 10, 10), (100, 10, 27, 26)], True),
        ([(0, 10, 10, 10), (100, 10, 34, 10)], False),
        ([(0, 10, 10, 10), (100, 10, 10, 34)], False),
    ]
    found = run(
        f"""
        return {[[list(tap) for tap in taps] for taps, _ in cases]}.map((taps) => {{
          controls.tap = null;
          return taps.flatMap(([start, long, x, y]) => {{
            send("pointerdown", at(x, y, {{ timeStamp: start }}));
            return send("pointerup", at(x, y, {{ timeStamp: start + long, pointerType: "touch" }}));
          }});
        }});
        """
    )
    for answer, (taps, picked) in zip(found, cases, strict=True):
        x, y = taps[-1][2:]
        assert answer == [["moved"]] + [["picked", x - 1, y - 2]] * picked + [["moved"]], taps


def test_a_tap_is_a_finger_that_stays_where_it_is() -> None:
    cases = [
        ("pointerup", 0, 0, "touch", [1]), ("pointerup", 23, 0, "touch", [1]), ("pointerup", 24, 0, "touch", []),
        ("pointerup", 0, 24, "touch", []), ("pointerup", 17, 17, "touch", []), ("pointercancel", 0, 0, "touch", [2]),
        ("pointerup", 0, 0, "mouse", []),
    ]  # fmt: skip
    found = run(
        f"""
        return {[list(case[:4]) for case in cases]}.map(([type, dx, dy, pointerType]) => {{
          controls.tap = null;
          return [[0, 0, 0, "pointerup"], [dx, dy, 100, type], [0, 0, 200, "pointerup"]].flatMap(([dx, dy, timeStamp,
            type], n) => {{
            send("pointerdown", at(50, 60, {{ timeStamp }}));
            const said = send(type, at(50 + dx, 60 + dy, {{ timeStamp: timeStamp + 10, pointerType }}));
            return said.some(([name]) => name === "picked") ? [n] : [];
          }});
        }});
        """
    )
    assert found == [case[4] for case in cases]


def test_a_third_tap_is_a_first_one_again() -> None:
    found = run(
        """
        return [0, 100, 200, 300].flatMap((timeStamp) => {
          send("pointerdown", at(5, 5, { timeStamp }));
          return send("pointerup", at(5, 5, { timeStamp: timeStamp + 20, pointerType: "touch" })).map(([name]) => name);
        });
        """
    )
    assert found == ["moved", "picked", "moved", "moved", "picked", "moved"]
