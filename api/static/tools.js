/** What a pointer does on the floor itself: pan, zoom, select and draw obstacles. */

import { byId, element, icon } from "./dom.js";
import { camera, draw, fit, inHand, pixel } from "./floor.js";
import { corners, disc, inside } from "./geometry.js";
import { shift } from "./grips.js";
import { palette } from "./palette.js";
import { removeObstacle } from "./panel.js";
import { trace } from "./robot.js";
import { edit, on, select, state, tell } from "./state.js";

const TOOLS = {
  select: ["Select and move", ""],
  box: ["Draw a box", "Drag from corner to corner."],
  polygon: [
    "Draw a polygon",
    "Click each corner; click the first again, or press Enter, to close it. Escape drops it.",
  ],
  circle: ["Draw a circle", "Drag from the centre outwards."],
};
const floor = byId("floor");
const pointers = new Map();
/** What is being drawn: corners in the world, and where the pointer is. */
let drawn = [],
  tip = null,
  gesture = null;

export function startTools() {
  for (const [name, [title]] of Object.entries(TOOLS)) byId("tools").append(toolButton(name, title));
  for (const [name, title, act] of [
    ["in", "Zoom in", () => zoom(1.4)],
    ["out", "Zoom out", () => zoom(1 / 1.4)],
    ["fit", "Show all", fit],
  ]) {
    const button = element("button", { type: "button", className: "icon", title }, icon(name));
    button.setAttribute("aria-label", title);
    button.addEventListener("click", act);
    byId("view").append(button);
  }
  const surface = byId("top");
  surface.addEventListener("pointerdown", down);
  surface.addEventListener("pointermove", move);
  surface.addEventListener("pointerup", up);
  surface.addEventListener("pointercancel", cancel);
  surface.addEventListener("wheel", wheel, { passive: false });
  document.addEventListener("keydown", keys);
  inHand.draw = drawInHand;
  on("tool", showTool);
  showTool();
}

function toolButton(name, title) {
  const button = element(
    "button",
    { type: "button", className: "icon", title, dataset: { tool: name } },
    icon(name),
  );
  button.setAttribute("aria-label", title);
  button.addEventListener("click", (event) => {
    take(name);
    // By keyboard there is no pointer to draw with: the obstacle comes to the middle of the view, selected.
    if (event.detail === 0 && name !== "select") drop(name);
  });
  return button;
}

function take(name) {
  state.tool = name;
  drawn = [];
  tell("tool");
  draw(false);
}

function showTool() {
  for (const button of byId("tools").children)
    button.setAttribute("aria-pressed", String(button.dataset.tool === state.tool));
  floor.dataset.tool = state.tool;
  byId("tip").textContent = TOOLS[state.tool][1];
  byId("tip").hidden = !TOOLS[state.tool][1];
}

function drop(kind) {
  const [x, y] = camera.toWorld([camera.width / 2, camera.height / 2]).map(tidy);
  const shapes = {
    circle: () => circle([x, y], 0.5),
    box: () => box([x - 0.5, y - 0.5], [x + 0.5, y + 0.5]),
  };
  add((shapes[kind] ?? shapes.box)());
  take("select");
}

const tidy = (value) => Number(value.toFixed(2)) + 0;
const circle = (center, radius) => ({ type: "circle", center: center.map(tidy), radius: tidy(radius) });
const box = ([x0, y0], [x1, y1]) =>
  polygon([
    [x0, y0],
    [x1, y0],
    [x1, y1],
    [x0, y1],
  ]);
const polygon = (vertices) => ({ type: "polygon", vertices: vertices.map((vertex) => vertex.map(tidy)) });

function add(obstacle) {
  const { environment } = state.request;
  state.selected = (environment.obstacles ?? []).length;
  edit(() => (environment.obstacles ??= []).push(obstacle), "obstacles");
  tell("announce", `Obstacle ${state.selected + 1} added.`);
  tell("settled");
}

const spot = (event) => {
  const bounds = floor.getBoundingClientRect();
  return [event.clientX - bounds.left, event.clientY - bounds.top];
};

function down(event) {
  if (event.button > 1) return;
  event.currentTarget.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, spot(event));
  document.activeElement?.blur?.();
  if (pointers.size === 2) {
    gesture = null;
    drawn = [];
    return;
  }
  const at = camera.toWorld(spot(event));
  gesture = event.button === 1 ? pan() : GESTURES[state.tool](at, spot(event));
}

function move(event) {
  const before = pointers.get(event.pointerId);
  const now = spot(event);
  tip = camera.toWorld(now);
  if (drawn.length) draw(false);
  if (!before) return;
  pointers.set(event.pointerId, now);
  if (pointers.size === 2) pinch(event.pointerId, before, now);
  else gesture?.move?.(tip, now, before);
}

function up(event) {
  pointers.delete(event.pointerId);
  gesture?.up?.(camera.toWorld(spot(event)), spot(event));
  gesture = null;
}

function cancel(event) {
  pointers.delete(event.pointerId);
  gesture = null;
}

const pan = () => ({
  move: (_, now, before) => {
    camera.pan(now[0] - before[0], now[1] - before[1]);
    tell("view");
  },
});

const GESTURES = {
  select: (at, from) => {
    const hit = obstacleAt(at);
    if (hit === null) {
      const panning = pan();
      return { ...panning, up: (_, to) => near(from, to) && state.selected !== null && select(null) };
    }
    if (hit !== state.selected) select(hit);
    let last = at,
      moved = false;
    return {
      move: (now, pixelNow) => {
        if (!moved && near(from, pixelNow)) return;
        moved = true;
        const [dx, dy] = [tidy(now[0] - last[0]), tidy(now[1] - last[1])];
        last = [last[0] + dx, last[1] + dy];
        edit((r) => shift(r.environment.obstacles[hit], dx, dy));
      },
      up: () => moved && tell("settled"),
    };
  },
  box: (at) => dragged(at, (to) => box(at, to)),
  circle: (at) => dragged(at, (to) => circle(at, Math.hypot(to[0] - at[0], to[1] - at[1]))),
  polygon: (at, from) => {
    const first = drawn[0] && camera.toScreen(drawn[0]);
    if (first && drawn.length > 2 && near(first, from, 12)) return { up: finish };
    drawn.push(at);
    tip = at;
    draw(false);
    return null;
  },
};

/** A shape that is dragged open: made where the pointer is let go, unless it has hardly moved. */
function dragged(at, shape) {
  drawn = [at];
  return {
    move: () => draw(false),
    up: (to) => {
      drawn = [];
      if (Math.hypot(to[0] - at[0], to[1] - at[1]) > 6 * pixel()) {
        add(shape(to));
        take("select");
      } else draw(false);
    },
  };
}

function finish() {
  const vertices = drawn;
  take("select");
  if (vertices.length > 2) add(polygon(vertices));
}

const near = ([ax, ay], [bx, by], within = 4) => Math.hypot(ax - bx, ay - by) < within;

/** The topmost obstacle at a point, or null. */
function obstacleAt(point) {
  const found = (state.request.environment.obstacles ?? []).findLastIndex((obstacle) =>
    inside(point, corners(obstacle)),
  );
  return found < 0 ? null : found;
}

function drawInHand(context) {
  if (!drawn.length || !tip) return;
  const [from] = drawn;
  const shapes = {
    box: () => box(from, tip).vertices,
    circle: () => disc(from, Math.hypot(tip[0] - from[0], tip[1] - from[1])),
    polygon: () => [...drawn, tip],
  };
  trace(context, shapes[state.tool]?.() ?? []);
  context.fillStyle = context.strokeStyle = palette.css.accent;
  context.globalAlpha = 0.15;
  context.fill();
  context.globalAlpha = 1;
  context.lineWidth = 1.6 * pixel();
  context.stroke();
}

function zoom(factor, at) {
  camera.zoom(factor, at);
  tell("view");
}

function wheel(event) {
  event.preventDefault();
  zoom(Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.0015)), spot(event));
}

function pinch(id, before, now) {
  const [other] = [...pointers].filter(([key]) => key !== id).map(([, at]) => at);
  const span = (at) => Math.hypot(at[0] - other[0], at[1] - other[1]) || 1;
  camera.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
  zoom(span(now) / span(before), [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2]);
}

function keys(event) {
  if (event.target.matches?.("input, textarea, select")) return;
  if (event.key === "Enter" && drawn.length && state.tool === "polygon") finish();
  else if (event.key === "Escape" && state.tool !== "select") take("select");
  else if (event.key === "Escape" && state.selected !== null) select(null);
  else if (/^(Delete|Backspace)$/.test(event.key) && state.selected !== null) removeObstacle(state.selected);
  else if (event.key === "+" || event.key === "=") zoom(1.25);
  else if (event.key === "-") zoom(1 / 1.25);
  else if (event.key === "0") fit();
  else return;
  event.preventDefault();
}
