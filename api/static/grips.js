/**
 * What can be held on the floor: poses, their headings, and the selected obstacle's corners. Each is a button,
 * so that it can be dragged, tabbed to, and moved with the arrow keys.
 */

import { byId, element } from "./dom.js";
import { camera, handle, isPlace } from "./floor.js";
import { degrees, short } from "./format.js";
import { middle } from "./geometry.js";
import { removeObstacle } from "./panel.js";
import { player, toggle } from "./player.js";
import { edit, on, state, tell } from "./state.js";

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const TURN = { ArrowLeft: 1, ArrowUp: 1, ArrowRight: -1, ArrowDown: -1 };
const made = new Map();

export function startGrips() {
  for (const topic of ["request", "view", "motion", "problem"]) on(topic, place);
}

/** A coordinate as a person would give it: to the centimetre. */
const tidy = (value) => Number(value.toFixed(2)) + 0;

/** Puts every grip where it belongs; those that are gone are taken away. */
function place() {
  if (!state.request) return;
  const wanted = grips();
  for (const [key, button] of made) {
    if (!wanted.has(key)) {
      button.remove();
      made.delete(key);
    }
  }
  for (const [key, grip] of wanted) {
    const button = made.get(key) ?? make(key);
    button.grip = grip;
    const [x, y] = camera.toScreen(grip.at);
    button.style.transform = `translate(${x}px, ${y}px)`;
    button.hidden = x < -20 || y < -20 || x > camera.width + 20 || y > camera.height + 20;
    button.setAttribute("aria-label", grip.says);
    button.classList.toggle("wrong", grip.wrong ?? false);
  }
}

/** Every grip by its key: where it is, what it says, and what moving and turning it does. */
function grips() {
  const wanted = new Map();
  for (const which of ["start", "goal"]) {
    const pose = state.request[which];
    if (!isPlace(pose)) continue;
    const name = which === "start" ? "Start" : "Goal";
    wanted.set(which, {
      at: [pose.x, pose.y],
      says: `${name} at ${short(pose.x)}, ${short(pose.y)} m`,
      wrong: state.problem?.code?.startsWith(`${which}-`),
      move: ([x, y]) => edit((r) => Object.assign(r[which], { x: tidy(x), y: tidy(y) }), "pose"),
      turn: (by) => turn(which, by),
    });
    if (pose.theta === null) continue;
    wanted.set(`${which} heading`, {
      at: handle(pose),
      says: `${name} heading ${degrees(pose.theta)} degrees`,
      wrong: state.problem?.code?.startsWith(`${which}-`),
      move: ([x, y]) => head(which, degrees(Math.atan2(y - pose.y, x - pose.x))),
      turn: (by) => turn(which, by),
      turns: true,
    });
  }
  const obstacle = state.request.environment.obstacles?.[state.selected];
  if (obstacle) for (const [key, grip] of obstacleGrips(obstacle, state.selected)) wanted.set(key, grip);
  return wanted;
}

function obstacleGrips(obstacle, index) {
  const change = (what) => edit((r) => what(r.environment.obstacles[index]));
  const remove = () => removeObstacle(index);
  const [mx, my] = middle(obstacle);
  const whole = {
    at: [mx, my],
    says: `Obstacle ${index + 1}`,
    move: ([x, y]) => change((o) => shift(o, x - mx, y - my)),
    remove,
  };
  if (obstacle.type === "circle") {
    const rim = [mx + obstacle.radius, my];
    const size = ([x, y]) => change((o) => (o.radius = Math.max(0.01, tidy(Math.hypot(x - mx, y - my)))));
    return [
      ["obstacle", whole],
      ["corner 0", { at: rim, says: `Radius ${short(obstacle.radius)} m`, move: size, remove }],
    ];
  }
  const vertices = obstacle.vertices.map((vertex, i) => [
    `corner ${i}`,
    {
      at: vertex,
      says: `Corner ${i + 1} of obstacle ${index + 1}`,
      move: ([x, y]) => change((o) => (o.vertices[i] = [tidy(x), tidy(y)])),
      remove,
    },
  ]);
  return [["obstacle", whole], ...vertices];
}

/** Moves an obstacle. */
export function shift(obstacle, dx, dy) {
  if (obstacle.type === "circle")
    obstacle.center = [tidy(obstacle.center[0] + dx), tidy(obstacle.center[1] + dy)];
  else obstacle.vertices = obstacle.vertices.map(([x, y]) => [tidy(x + dx), tidy(y + dy)]);
}

function turn(which, by) {
  if (state.request[which].theta !== null) head(which, degrees(state.request[which].theta) + by);
}

function head(which, angle) {
  const radians = (((((angle + 180) % 360) + 360) % 360) - 180) * (Math.PI / 180);
  edit((r) => (r[which].theta = Number(radians.toFixed(4)) + 0), "pose");
}

function make(key) {
  const kind = key.replace(/ \d+$/, "").replace(" ", "-");
  const button = element("button", { type: "button", className: `grip ${kind}`, dataset: { grip: key } });
  button.setAttribute("aria-roledescription", "grip");
  button.addEventListener("keydown", key_);
  button.addEventListener("pointerdown", hold);
  made.set(key, button);
  byId("grips").append(button);
  return button;
}

function hold(event) {
  if (event.button !== 0) return;
  event.stopPropagation();
  const button = event.currentTarget;
  const bounds = byId("floor").getBoundingClientRect();
  const from = camera.toScreen(button.grip.at);
  const off = [event.clientX - bounds.left - from[0], event.clientY - bounds.top - from[1]];
  button.setPointerCapture(event.pointerId);
  button.focus({ preventScroll: true });
  const move = (e) =>
    button.grip.move(camera.toWorld([e.clientX - bounds.left - off[0], e.clientY - bounds.top - off[1]]));
  const release = () => {
    button.removeEventListener("pointermove", move);
    tell("settled");
  };
  button.addEventListener("pointermove", move);
  button.addEventListener("lostpointercapture", release, { once: true });
}

/** Arrows move by 0.1 m, with Shift by 0.01 m; a heading turns by 5°, with Shift by 1°. Brackets turn too. */
function key_(event) {
  const { grip } = event.currentTarget;
  const arrow = ARROWS[event.key];
  const fine = event.shiftKey;
  if (arrow && grip.turns) grip.turn(TURN[event.key] * (fine ? 1 : 5));
  else if (arrow) grip.move(grip.at.map((value, axis) => value + arrow[axis] * (fine ? 0.01 : 0.1)));
  else if ((event.key === "[" || event.key === "]") && grip.turn) grip.turn(event.key === "[" ? 5 : -5);
  else if (/^(Delete|Backspace)$/.test(event.key) && grip.remove) grip.remove();
  else if (event.key === " " && (player.playing || state.motion)) toggle();
  else return;
  event.preventDefault();
  event.stopPropagation();
  if (arrow || event.key === "[" || event.key === "]") {
    tell("announce", event.currentTarget.getAttribute("aria-label"));
    tell("settled");
  }
}
