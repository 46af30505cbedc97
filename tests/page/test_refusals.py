"""Each refusal is shown where it belongs."""

import json

import pytest


def notice(view):
    return view.page.inner_text("#notice")


def test_a_field_error_stands_next_to_its_field_in_the_services_words(open_page):
    view = open_page()
    view.field("/robot/drive/track_width").fill("0")
    view.edit("r.options.time_budget = 1e9; r.environment.obstacles[4].vertices = [[0, 0], [1, 1]]")
    view.plan()
    said = view.page.locator("[data-pointer='/robot/drive/track_width'] .error").inner_text()
    assert said.startswith("track_width is 0; it must be >")
    assert view.field("/robot/drive/track_width").get_attribute("aria-invalid") == "true"
    assert (
        "vertices has 2 items"
        in view.page.locator("[data-pointer='/environment/obstacles/4/vertices'] .error").inner_text()
    )
    assert view.page.is_visible("[data-pointer='/environment/obstacles/4/vertices']")
    view.picture("fields")
    view.field("/robot/drive/track_width").fill("0.5")
    assert view.page.locator("#setup .error").count() == 0
    assert view.page.is_hidden("#notice")


def test_an_error_of_one_wheels_limit_stands_at_that_wheel(open_page):
    view = open_page()
    view.reveal("limits")
    view.page.click("[aria-label='Wheel speed: by wheel']")
    view.field("/robot/limits/wheel_speed/rear_left").fill("-1")
    view.plan()
    said = view.page.locator("[data-pointer='/robot/limits/wheel_speed/rear_left'] .error").inner_text()
    assert said.startswith("rear_left is -1; it must be >")


@pytest.mark.parametrize(("which", "x", "y", "hit"), [("start", 2.2, 1.5, 0), ("goal", 8, 4.3, 3)])
def test_a_pose_in_collision_is_marked_with_what_it_hits(open_page, which, x, y, hit):
    view = open_page()
    view.edit(f"Object.assign(r.{which}, {{ x: {x}, y: {y} }})")
    view.plan()
    assert "in collision" in notice(view)
    assert f"obstacle {hit + 1}" in notice(view)
    assert view.state("state.problem.hit") == hit
    assert "wrong" in view.page.get_attribute(f"[data-grip={which}]", "class")
    other = {"start": "goal", "goal": "start"}[which]
    assert "wrong" not in view.page.get_attribute(f"[data-grip={other}]", "class")
    view.picture(f"collision-{which}")
    view.page.click("[aria-label=Dismiss]")
    assert "wrong" not in view.page.get_attribute(f"[data-grip={which}]", "class")


def test_a_way_that_is_proven_too_narrow_is_marked(open_page):
    view = open_page()
    view.edit("r.environment.obstacles.push(...[[0, 2.5], [3, 6]].map(([a, b]) => "
              "({ type: 'polygon', vertices: [[10.2, a], [10.4, a], [10.4, b], [10.2, b]] })))")  # fmt: skip
    view.plan()
    assert "No path exists" in notice(view)
    assert "500 mm" in notice(view)
    proof = view.state("state.problem.proof")
    assert (proof["x"], proof["y"]) == pytest.approx((10.3, 2.75), abs=0.2)
    view.picture("no-path")


def test_a_full_queue_says_when_to_try_again(open_page):
    view = open_page()
    problem = {
        "code": "overloaded",
        "title": "The queue is full",
        "status": 429,
        "detail": "Busy.",
        "retry_after": 1,
    }
    view.page.route(
        "**/v1/plans",
        lambda route: route.fulfill(
            status=429, content_type="application/problem+json", body=json.dumps(problem)
        ),
    )
    view.plan()
    assert "Try again in 1 s" in notice(view)
    view.picture("overloaded")
    view.page.unroute("**/v1/plans")
    view.page.click("#notice >> text=/^Try again$/")
    view.page.wait_for_selector("#dock:not([hidden])")
    assert view.page.is_hidden("#notice")


def test_a_service_that_has_gone_is_said_to_have_gone(open_page):
    view = open_page()
    view.page.route("**/v1/plans", lambda route: route.abort())
    view.plan()
    view.faults = [fault for fault in view.faults if "ERR_FAILED" not in fault]
    assert "does not answer" in notice(view)


def test_a_map_of_one_file_is_explained(open_page):
    view = open_page()
    view.reveal("space")
    half = {"name": "room.yaml", "mimeType": "text/yaml", "buffer": b"image: room.pgm\n"}
    view.page.set_input_files("details[data-section=space] input[type=file]", [half])
    view.page.wait_for_selector("#notice:not([hidden])")
    assert "two files" in notice(view)


def test_a_link_that_is_no_setup_opens_the_example(open_page):
    for broken in ("#r=AAAA", "#r=!", "#other"):
        view = open_page(at=f"/{broken}")
        assert view.state("state.request.robot.drive.type") == "ackermann"


@pytest.mark.parametrize("kind", ["ackermann", "swedish", "synchro"])
def test_a_field_that_is_being_typed_breaks_nothing_that_is_drawn(open_page, kind):
    view = open_page()
    view.field("/robot/drive/type").select_option(kind)
    view.edit("r.environment.obstacles = [{ type: 'polygon', vertices: [[5, 5], [6, 5], [6, 5.5]] }]")
    for section in ("footprint", "limits", "start", "goal", "space", "obstacles", "options"):
        view.reveal(section)
    view.page.click(".obstacle")
    parts = "(({ robot, ...others }) => [others, robot.limits])(state.request)"
    before = view.state(parts)
    typed = view.page.locator("#setup :is(input[type=number], input[type=text], textarea)").all()
    assert len(typed) > 20
    for one in typed:
        was = one.input_value()
        for text in ("", "-") if one.get_attribute("type") != "number" else ("", "-1", "1e9"):
            one.fill(text)
            view.page.evaluate("() => new Promise(requestAnimationFrame)")
        one.fill(was)
    assert view.state(parts) == before
