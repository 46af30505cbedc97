"""The page by keyboard alone, in either theme, on a tablet, and while a plan is still getting better."""

import json

import pytest

from tests.service.service import serving

STREAM = """
const real = window.fetch;
window.fetch = async (path, init) => {
  if (path !== "/v1/plans") return real(path, init);
  window.accepted = init.headers.Accept;
  const headers = { ...init.headers, Accept: "application/json" };
  const body = JSON.stringify({ ...JSON.parse(init.body), options: { effort: "first" } });
  const plan = await (await real(path, { ...init, headers, body, signal: undefined })).json();
  const block = (name, data) => `event: ${name}\\ndata: ${JSON.stringify(data)}\\n\\n`;
  const text = (name, data) => new TextEncoder().encode(block(name, data));
  const stream = new ReadableStream({
    start(controller) {
      window.send = (name, data) => controller.enqueue(text(name, data));
      window.plan = plan;
      controller.enqueue(text("plan", { plan, elapsed: 0.2, final: false }));
      init.signal.addEventListener("abort", () => {
        window.stopped = true;
        controller.error(new DOMException("", "AbortError"));
      });
    },
  });
  return new Response(stream, { headers: { "Content-Type": "text/event-stream" } });
};
"""


def focused(view):
    return view.page.evaluate("() => document.activeElement.id || document.activeElement.dataset.grip || ''")


def tab_to(view, wanted):
    for _ in range(80):
        view.page.keyboard.press("Tab")
        if focused(view) == wanted:
            return
    raise AssertionError(f"Tab does not lead to {wanted}")


def brightness(view, x, y):
    """Of one pixel of the floor plan, 0 to 255."""
    return view.page.evaluate(
        "([x, y]) => { const c = document.getElementById('base');"
        "const d = c.getContext('2d').getImageData(x, y, 1, 1).data; return (d[0] + d[1] + d[2]) / 3; }",
        [x, y],
    )


def test_by_keyboard_alone_one_plans_moves_turns_and_plays(open_page):
    view = open_page()
    keyboard = view.page.keyboard
    tab_to(view, "plan")
    keyboard.press("Enter")
    view.settle()
    view.page.wait_for_selector("#dock:not([hidden])")
    assert focused(view) == "plan"
    tab_to(view, "start")
    keyboard.press("ArrowRight")
    keyboard.press("Shift+ArrowDown")
    start = view.state("state.request.start")
    assert (start["x"], start["y"]) == pytest.approx((1.1, 0.84))
    assert view.page.inner_text("#said").startswith("Start at 1.1, 0.84")
    tab_to(view, "start heading")
    keyboard.press("ArrowUp")
    assert view.state("state.request.start.theta") == pytest.approx(0.0873, abs=1e-3)
    ring = view.page.evaluate("() => getComputedStyle(document.activeElement, '::before').outlineStyle")
    assert ring == "solid"
    view.picture("keyboard")
    tab_to(view, "scrub")
    keyboard.press("Home")
    keyboard.press("ArrowRight")
    keyboard.press("Shift+ArrowRight")
    assert view.page.inner_text("#clock").startswith("1.10 /")
    keyboard.press("Space")
    assert view.page.get_attribute("#play", "aria-label") == "Pause"
    keyboard.press("Space")
    assert view.page.get_attribute("#play", "aria-label") == "Play"


def test_an_obstacle_is_made_and_moved_by_keyboard(open_page):
    view = open_page()
    view.page.focus("[data-tool=circle]")
    view.page.keyboard.press("Enter")
    made = view.state("state.request.environment.obstacles.at(-1)")
    assert made["type"] == "circle"
    tab_to(view, "obstacle")
    view.page.keyboard.press("ArrowLeft")
    moved = view.state("state.request.environment.obstacles.at(-1)")
    assert moved["center"] == pytest.approx([made["center"][0] - 0.1, made["center"][1]], abs=1e-6)
    view.page.keyboard.press("Delete")
    assert len(view.state("state.request.environment.obstacles")) == 11


def test_everything_one_can_operate_has_a_name(open_page):
    view = open_page()
    view.plan()
    for section in ("footprint", "limits", "start", "goal", "space", "obstacles", "options"):
        view.reveal(section)
    nameless = view.page.evaluate("""() => [...document.querySelectorAll("button, input, select, textarea")]
      .filter((one) => one.checkVisibility())
      .filter((one) => !one.getAttribute("aria-label") && !one.textContent.trim()
        && ![...(one.labels ?? [])].some((label) => label.textContent.trim()))
      .map((one) => one.outerHTML)""")
    assert nameless == []
    view.picture("sections")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_page_and_the_plan_follow_the_theme_of_the_system(open_page, theme):
    view = open_page(color_scheme=theme)
    view.plan()
    view.page.evaluate("() => import('/static/player.js').then((p) => (p.pause(), p.seek(5.6)))")
    view.page.wait_for_timeout(100)
    assert (brightness(view, 5, 5) > 128) == (theme == "light")
    ink, paper = view.page.evaluate(
        "() => ['color', 'backgroundColor'].map((of) => getComputedStyle(document.body)[of].match(/\\d+/g)"
        ".slice(0, 3).reduce((sum, part) => sum + Number(part), 0) / 3)"
    )
    assert (paper > ink) == (theme == "light")
    assert abs(paper - ink) > 150
    view.picture(theme)


def test_the_theme_button_overrules_the_system_and_is_remembered(open_page):
    view = open_page()
    view.page.click("#theme")
    view.page.click("#theme")
    assert view.page.get_attribute("#theme", "aria-label") == "Theme: dark"
    view.page.wait_for_timeout(100)
    assert brightness(view, 5, 5) < 128
    view.page.reload()
    view.page.wait_for_selector("html[data-ready]")
    assert view.page.get_attribute("#theme", "aria-label") == "Theme: dark"


@pytest.mark.parametrize(("width", "height"), [(1024, 768), (820, 1180)])
def test_on_a_tablet_nothing_is_cut_off_and_a_finger_drags(open_page, width, height):
    view = open_page(width, height, has_touch=True)
    view.plan()
    assert view.page.evaluate("() => document.documentElement.scrollWidth") <= width
    for part in ("#floor", "#plan", "#play"):
        box = view.page.locator(part).bounding_box()
        assert box["x"] >= 0, part
        assert box["x"] + box["width"] <= width, part
        assert box["y"] + box["height"] <= height, part
    x, y = view.grip("goal")
    touch = view.page.context.new_cdp_session(view.page)
    for kind, dx in (("touchStart", 0), ("touchMove", -20), ("touchMove", -40), ("touchEnd", None)):
        points = [] if dx is None else [{"x": x + dx, "y": y}]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert view.grip("goal") == pytest.approx((x - 40, y), abs=2)
    view.plan()
    view.page.evaluate("() => import('/static/player.js').then((p) => (p.pause(), p.seek(5)))")
    view.picture(f"tablet-{width}")


def test_a_motion_that_is_reduced_does_not_begin_by_itself(open_page):
    view = open_page(reduced_motion="reduce")
    view.plan()
    assert view.page.get_attribute("#play", "aria-label") == "Play"


def test_improvements_are_shown_as_they_come_and_the_last_one_is_final(open_page):
    view = open_page(script=STREAM)
    view.edit("r.options.effort = 'best'")
    view.page.click("#plan")
    view.page.wait_for_selector("#dock:not([hidden])")
    assert view.page.evaluate("() => window.accepted").startswith("text/event-stream")
    assert "Improving" in view.page.inner_text("#plan")
    view.picture("improving")
    better = "() => send('plan', { plan: { ...plan, id: 'better' }, elapsed: 1.5, final: true })"
    view.page.evaluate(better)
    view.settle()
    assert view.state("state.motion.answer.id") == "better"
    assert view.page.is_hidden("#stop")


def test_stopping_keeps_the_best_so_far(open_page):
    view = open_page(script=STREAM)
    view.edit("r.options.effort = 'best'")
    view.page.click("#plan")
    view.page.wait_for_selector("#stop >> text=Stop, keep this one")
    view.page.click("#stop")
    view.settle()
    assert view.page.evaluate("() => window.stopped")
    assert view.state("state.motion.answer.id") == view.page.evaluate("() => plan.id")
    assert view.page.is_hidden("#notice")


def test_a_stream_that_ends_in_a_problem_shows_it(open_page):
    view = open_page(script=STREAM)
    view.edit("r.options.effort = 'best'")
    view.page.click("#plan")
    view.page.wait_for_selector("#dock:not([hidden])")
    problem = json.dumps({"code": "worker-crashed", "title": "The process died", "detail": "Try again."})
    view.page.evaluate(f"() => send('problem', {problem})")
    view.page.wait_for_selector("#notice:not([hidden])")
    assert "The process died" in view.page.inner_text("#notice")
    assert view.state("state.motion !== null")


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A service that asks for tokens."""
    folder = tmp_path_factory.mktemp("guarded")
    (folder / "tokens").write_text("the-token\n")
    with serving(folder, "the-token", workers=1, tokens_file=folder / "tokens") as server:
        yield server, folder / "tokens"


def test_where_the_service_wants_a_token_the_page_asks_for_it(open_page, guarded):
    server, _ = guarded
    view = open_page(of=f"http://127.0.0.1:{server.port}")
    view.page.wait_for_selector("#access[open]")
    view.picture("token")
    view.page.fill("#token", "a-wrong-one")
    view.page.keyboard.press("Enter")
    view.page.wait_for_selector("#access-note >> text=does not know")
    view.page.fill("#token", "the-token")
    view.page.keyboard.press("Enter")
    view.page.wait_for_selector("html[data-ready]")
    view.edit("r.options.effort = 'first'")
    view.plan()
    assert view.page.is_visible("#dock")
    assert "Bearer $TOKEN" in view.page.text_content("#curl")
    assert "the-token" not in view.page.text_content("#curl")


def test_a_token_that_is_withdrawn_is_asked_for_again_and_the_plan_goes_on(open_page, guarded):
    server, tokens = guarded
    remembered = "sessionStorage.setItem('wheelplan-token', 'the-token')"
    view = open_page(of=f"http://127.0.0.1:{server.port}", script=remembered)
    view.page.wait_for_selector("html[data-ready]")
    view.edit("r.options.effort = 'first'")
    tokens.write_text("the-next-token\n")
    try:
        view.page.click("#plan")
        view.page.wait_for_selector("#access-note >> text=does not know")
        view.page.fill("#token", "the-next-token")
        view.page.keyboard.press("Enter")
        view.settle()
        assert view.page.is_visible("#dock")
        tokens.write_text("another-one\n")
        view.page.click("#plan")
        view.page.wait_for_selector("#access[open]")
        view.page.keyboard.press("Escape")
        view.settle()
        assert "A token is needed" in view.page.inner_text("#notice")
    finally:
        tokens.write_text("the-token\n")


def test_where_the_service_wants_a_token_the_documentation_opens_and_takes_it(open_page, guarded):
    server, _ = guarded
    view = open_page(of=f"http://127.0.0.1:{server.port}", at="/docs")
    page = view.page
    page.click("button.authorize")
    page.fill(".auth-container input", "the-token")
    page.click(".auth-btn-wrapper button.authorize")
    page.click(".auth-btn-wrapper button.btn-done")
    operation = page.locator("#operations-operations-limits_v1_limits_get")
    operation.locator(".opblock-summary-control").click()
    operation.locator("button.try-out__btn").click()
    operation.locator("button.execute").click()
    status = operation.locator(".live-responses-table .response-col_status").last
    status.wait_for()
    view.picture("docs")
    assert status.inner_text().startswith("200")
    page.locator("#operations-operations-livez_livez_get").wait_for()
    assert page.locator("#operations-operations-livez_livez_get .authorization__btn").count() == 0
