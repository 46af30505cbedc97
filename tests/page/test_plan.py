"""Setting up, planning, watching: what a person does on the page at /."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

WAREHOUSE = Path(__file__).parents[2] / "examples" / "warehouse"

DRIVES = (
    "differential", "tracked", "skid_steer", "omni", "mecanum", "swedish", "tricycle", "ackermann", "synchro",
    "swerve", "powered_caster",
)  # fmt: skip


def scale(view):
    """Pixels a metre."""
    return view.page.evaluate("import('/static/floor.js').then(({ camera }) => camera.scale)")


def pixel(view, x, y):
    """Where a point of the world is on the screen."""
    at = view.page.evaluate(f"import('/static/floor.js').then(({{ camera }}) => camera.toScreen([{x}, {y}]))")
    floor = view.page.locator("#floor").bounding_box()
    return floor["x"] + at[0], floor["y"] + at[1]


def test_the_example_plans_at_once_and_plays(open_page):
    view = open_page()
    view.picture("opening")
    view.plan()
    answer = view.state("({ duration: state.motion.answer.duration, length: state.motion.answer.length })")
    figures = view.page.locator(".figures").inner_text()
    assert f"{answer['duration']:.2f}" in figures
    assert f"{answer['length']:.2f}" in figures
    assert view.page.locator(".lamps li").count() >= 6
    assert view.page.locator(".lamps li", has_text="Wheel speed").locator("b").inner_text().endswith("%")
    titles = view.page.locator(".chart h3").all_inner_texts()
    assert [title.split("\n")[0].split("rad")[0].strip() for title in titles] == [
        "Wheel rate", "Wheel acceleration", "Steering angle",
    ]  # fmt: skip
    before = view.page.inner_text("#clock")
    view.page.wait_for_function(
        "(before) => document.getElementById('clock').textContent !== before", arg=before
    )
    assert view.page.get_attribute("#play", "aria-label") == "Pause"
    view.page.click("#play")
    view.picture("planned")


def test_dragging_moves_a_pose_by_as_many_metres_as_pixels_say(open_page):
    view = open_page()
    start, goal = view.state("[state.request.start, state.request.goal]")
    x, y = view.grip("start")
    view.drag((x, y), (x + 60, y + 30))
    moved = view.state("state.request.start")
    assert moved["x"] == pytest.approx(start["x"] + 60 / scale(view), abs=0.011)
    assert moved["y"] == pytest.approx(start["y"] - 30 / scale(view), abs=0.011)
    assert moved["theta"] == start["theta"]
    x, y = view.grip("goal")
    view.drag(view.grip("goal heading"), (x, y - 90))
    turned = view.state("state.request.goal")
    assert turned["theta"] == pytest.approx(math.pi / 2, abs=math.radians(1.1))
    assert (turned["x"], turned["y"]) == (goal["x"], goal["y"])
    view.reveal("start")
    assert float(view.field("/start/x").input_value()) == moved["x"]
    view.picture("dragged")


def test_the_scrubber_the_charts_and_the_robot_tell_one_time(open_page):
    view = open_page()
    view.plan()
    view.page.locator("#scrub").focus()
    view.page.keyboard.press("End")
    duration = view.state("state.motion.duration")
    assert view.page.inner_text("#clock") == f"{duration:.2f} / {duration:.2f} s"
    plot = view.page.locator(".plot").first.bounding_box()
    view.page.mouse.click(plot["x"] + 40 + 0.25 * (plot["width"] - 50), plot["y"] + 40)
    now = view.page.evaluate("import('/static/player.js').then(({ player }) => player.time)")
    assert now == pytest.approx(0.25 * duration, abs=0.02 * duration)
    shown = view.page.locator(".legend").first.locator("li").first.locator("b").inner_text()
    time, rate = view.state(
        "[state.motion.answer.schedule.time, state.motion.answer.schedule.wheels.front_left.velocity]"
    )
    i = min(range(len(time)), key=lambda k: abs(time[k] - now))
    steps = [abs(rate[k + 1] - rate[k]) for k in (i - 1, i)]
    assert float(shown.replace("−", "-")) == pytest.approx(rate[i], abs=0.006 + max(steps))
    cursors = [box["x"] for box in (c.bounding_box() for c in view.page.locator(".cursor").all())]
    plots = [box["x"] for box in (p.bounding_box() for p in view.page.locator(".plot").all())]
    offsets = [c - p for c, p in zip(cursors, plots, strict=True)]
    assert max(offsets) - min(offsets) < 2
    view.picture("scrubbed")


def test_every_drive_is_offered_and_what_the_page_makes_of_its_example_can_be_planned(open_page):
    view = open_page()
    kinds = view.field("/robot/drive/type").locator("option").all()
    assert {option.get_attribute("value") for option in kinds} == set(DRIVES)
    for kind in DRIVES:
        view.field("/robot/drive/type").select_option(kind)
        view.edit("r.options.effort = 'first'; r.goal.theta = null")
        view.plan()
        assert view.page.is_hidden("#notice"), (kind, view.page.inner_text("#notice"))
        wheels = view.state("state.motion.wheels.map((w) => w.name)")
        drawn = view.state("state.motion.layout.map((w) => w.name)")
        assert drawn == wheels, kind
        view.page.evaluate("import('/static/player.js').then((p) => (p.pause(), p.seek(2)))")
        view.picture(f"drive-{kind}")


def test_the_wheels_are_drawn_where_they_roll_as_the_service_says(open_page, service):
    view = open_page()
    for kind in DRIVES:
        example = view.state(f"state.drives.get('{kind}').example")
        layout = f"() => import('/static/wheels.js').then((m) => m.wheelsOf({json.dumps(example)}))"
        wheels = view.page.evaluate(layout)
        steering = {wheel["name"]: 0.4 for wheel in wheels} if kind == "powered_caster" else {}
        for vx, vy, omega in [(0.5, 0.2, 0.3), (-0.1, 0.4, -0.6)]:
            if kind not in ("omni", "mecanum", "swedish", "swerve", "powered_caster"):
                vy = 0.0
            if kind == "synchro":  # whose body does not turn
                omega = 0.0
            asked = {"drive": example, "twist": {"vx": vx, "vy": vy, "omega": omega}}
            if steering:
                asked["steering"] = steering
            answer = view.page.request.post(f"{service}/v1/kinematics/inverse", data=asked).json()
            for wheel in wheels:
                angle = wheel["heading"] + (steering or answer["steering"]).get(wheel["name"], 0.0)
                # A roller passes on what goes along its axis: at the floor the mirror image of the drawn.
                roller = -wheel.get("roller", 0.0)
                at_wheel = vx - omega * wheel["y"], vy + omega * wheel["x"]
                along = at_wheel[0] * math.cos(angle + roller) + at_wheel[1] * math.sin(angle + roller)
                rolled = answer["wheels"][wheel["name"]] * wheel["radius"] * math.cos(roller)
                assert along == pytest.approx(rolled, abs=1e-9), (kind, wheel["name"])


def test_a_map_is_uploaded_and_planned_on(open_page):
    view = open_page()
    view.reveal("space")
    files = [WAREHOUSE / "warehouse.yaml", WAREHOUSE / "warehouse.pgm"]
    view.page.set_input_files("details[data-section=space] input[type=file]", files)
    view.page.wait_for_function(
        "() => document.querySelector('[data-pointer=\"/environment/map\"] select')?.value.length === 64"
    )
    assert view.state("state.request.environment.bounds ?? null") is None
    view.edit("r.start = { x: 3.4, y: 7.1, theta: 0 }; r.goal = { x: 20.4, y: 4.9, theta: 3.1416 }")
    view.plan()
    assert "in collision" in view.page.inner_text("#notice")
    view.picture("collision-map")
    view.edit("r.start = { x: 4.9, y: 11.3, theta: 0 }")
    view.plan()
    assert view.page.is_hidden("#notice"), view.page.inner_text("#notice")
    assert (
        view.state("state.motion.request.environment.map.id") == view.field("/environment/map").input_value()
    )
    view.picture("map")
    view.field("/environment/map").select_option("")
    assert len(view.state("state.request.environment.obstacles")) == 11


def test_obstacles_are_drawn_moved_and_deleted(open_page):
    view = open_page()
    obstacles = "state.request.environment.obstacles"
    before = len(view.state(obstacles))
    view.page.click("[data-tool=box]")
    view.drag(pixel(view, 5.6, 3), pixel(view, 6.4, 3.6))
    box = view.state(f"{obstacles}.at(-1)")
    assert np.array(box["vertices"]) == pytest.approx(
        np.array([[5.6, 3.0], [6.4, 3.0], [6.4, 3.6], [5.6, 3.6]]), abs=0.02
    )
    view.page.click("[data-tool=circle]")
    view.drag(pixel(view, 10, 5.4), pixel(view, 10.3, 5.4))
    disc = view.state(f"{obstacles}.at(-1)")
    assert disc["center"] == pytest.approx([10, 5.4], abs=0.02)
    assert disc["radius"] == pytest.approx(0.3, abs=0.03)
    view.page.click("[data-tool=polygon]")
    for corner in ((0.4, 4.6), (1.4, 4.6), (0.9, 5.4)):
        view.page.mouse.click(*pixel(view, *corner))
    view.picture("drawing")
    view.page.keyboard.press("Enter")
    assert len(view.state(f"{obstacles}.at(-1).vertices")) == 3
    view.drag(view.grip("obstacle"), pixel(view, 1.4, 4.87))
    assert view.state(f"{obstacles}.at(-1).vertices[0]") == pytest.approx([0.9, 4.6], abs=0.03)
    view.drag(view.grip("corner 2"), pixel(view, 1.6, 5.6))
    assert view.state(f"{obstacles}.at(-1).vertices[2]") == pytest.approx([1.6, 5.6], abs=0.03)
    view.page.wait_for_timeout(450)
    view.page.keyboard.press("Delete")
    assert len(view.state(obstacles)) == before + 2
    assert view.state("state.selected") is None
    view.page.keyboard.press("Control+z")
    assert len(view.state(obstacles)) == before + 3
    view.drag(pixel(view, 3, 2), pixel(view, 3.1, 1.9))
    assert view.state(f"{obstacles}[0].vertices[0]") == pytest.approx([2.3, 1.6], abs=0.03)


def test_a_plan_that_no_longer_fits_the_setup_is_shown_as_such_until_the_next(open_page):
    view = open_page()
    view.plan()
    assert not view.state("state.stale")
    view.field("/robot/drive/wheel_radius").fill("0.14")
    assert view.state("state.stale")
    assert "stale" in view.page.get_attribute("#dock", "class")
    view.picture("stale")
    view.plan()
    assert not view.state("state.stale")


def test_it_plans_by_itself_where_that_is_asked_for(open_page):
    view = open_page()
    view.edit("r.options.effort = 'first'")
    view.page.check("#live")
    view.page.wait_for_selector("#dock:not([hidden])")
    x, y = view.grip("start")
    view.drag((x, y), (x + 10, y - 12))
    view.page.wait_for_function(
        "() => import('/static/state.js')"
        ".then(({ state }) => !state.stale && state.motion?.request.start.x > 1.05)"
    )


def test_export_gives_the_command_the_files_and_a_link_that_brings_the_setup_back(open_page):
    view = open_page(permissions=["clipboard-read", "clipboard-write"])
    view.edit("r.start.y = 0.9")
    view.plan()
    view.page.click("#share")
    command = view.page.inner_text("#curl")
    assert command.startswith(f"curl -s {view.page.url.rstrip('/')}/v1/plans")
    assert '"y":0.9' in command
    view.picture("export")
    view.page.select_option("#format", "text/csv")
    with view.page.expect_download() as csv:
        view.page.click("#download")
    table = Path(csv.value.path()).read_text()
    theirs = view.page.evaluate(
        "() => import('/static/state.js').then(({ state }) => fetch('/v1/plans?format=csv', { method: 'POST',"
        "headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(state.motion.request) }))"
        ".then((answer) => answer.text())"
    )
    assert table.splitlines()[0] == theirs.splitlines()[0]
    ours, own = (np.genfromtxt(text.splitlines()[1:], delimiter=",") for text in (table, theirs))
    assert ours == pytest.approx(own)
    view.page.select_option("#format", "application/json")
    with view.page.expect_download() as file:
        view.page.click("#download")
    assert file.value.suggested_filename.endswith(".json")
    view.page.click("#copy-link")
    view.page.wait_for_selector("#copy-link >> text=Copied")
    link = view.page.evaluate("navigator.clipboard.readText()")
    again = open_page(at="/#" + link.partition("#")[2])
    assert again.state("state.request.start.y") == 0.9


def test_a_goal_that_is_the_start_gives_a_plan_of_no_duration(open_page):
    view = open_page()
    view.edit("r.goal = { ...r.start }")
    view.plan()
    assert view.page.inner_text("#clock") == "0.00 / 0.00 s"
    view.page.click("#play")
    assert view.page.get_attribute("#play", "aria-label") == "Play"
    view.picture("standing")
