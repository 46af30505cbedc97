/**
 * The floor plan: two canvases. `base` holds what stands still and is drawn anew only when that or the view
 * changes; `top` holds the poses and the moving robot.
 */

import { Camera } from "./camera.js";
import { byId } from "./dom.js";
import { short } from "./format.js";
import { corners, extent, outline, placed, reach } from "./geometry.js";
import { drawHits, drawMotion, drawWorld, gridStep } from "./layers.js";
import { mapCorners, summary } from "./maps.js";
import { palette } from "./palette.js";
import { player } from "./player.js";
import { drawRobot, trace } from "./robot.js";
import { on, state, tell } from "./state.js";
import { wheelsOf } from "./wheels.js";

export const camera = new Camera();
/** Draws what a tool has in hand; set by tools.js. */
export const inHand = { draw: () => {} };

const base = byId("base").getContext("2d", { alpha: false });
const top = byId("top").getContext("2d");
const scratch = new OffscreenCanvas(1, 1);
let ratio = 1,
  baseDue = true,
  due = false;

export function startFloor() {
  new ResizeObserver(() => {
    if (!state.request || !resize()) return;
    baseDue = true;
    frame(); // at once: a canvas that has been sized is empty
  }).observe(byId("floor"));
  for (const topic of ["motion", "problem", "theme", "view"]) on(topic, () => draw(true));
  on("request", (rebuild) => draw(rebuild !== "pose"));
  on("time", () => draw(false));
  on("fit", fit);
}

/** Has the floor drawn at the next frame, with its base where that has changed. */
export function draw(withBase) {
  baseDue ||= withBase;
  if (due) return;
  due = true;
  requestAnimationFrame(frame);
}

/** Shows all of the bounds, the map and the poses. */
export function fit() {
  const { environment, start, goal } = state.request;
  const { bounds, obstacles = [] } = environment;
  const map = summary();
  const points = [start, goal].filter(isPlace).map(({ x, y }) => [x, y]);
  if (bounds) points.push([bounds.x_min, bounds.y_min], [bounds.x_max, bounds.y_max]);
  else if (map) points.push(...mapCorners(map));
  else points.push(...obstacles.flatMap(corners));
  const box = extent(points.filter((point) => point.every(Number.isFinite)));
  camera.fit(box);
  tell("view");
}

/** How long a pixel is in the world, m. */
export const pixel = () => 1 / camera.scale;

/** Takes the size that the floor has now; whether that is another than before. */
function resize() {
  const { clientWidth: width, clientHeight: height } = byId("floor");
  const now = Math.min(2, devicePixelRatio || 1);
  if (!width || !height || (width === camera.width && height === camera.height && now === ratio))
    return false;
  ratio = now;
  for (const { canvas } of [base, top]) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  camera.width = width;
  camera.height = height;
  fit();
  return true;
}

function frame() {
  due = false;
  if (!state.request) return;
  if (baseDue) {
    resize();
    drawBase();
  }
  baseDue = false;
  drawTop();
}

function drawBase() {
  base.setTransform(1, 0, 0, 1, 0, 0);
  base.fillStyle = palette.css.void;
  base.fillRect(0, 0, base.canvas.width, base.canvas.height);
  camera.apply(base, ratio);
  drawWorld(base, camera, pixel());
  if (state.motion) drawMotion(base, state.motion, pixel(), scratch);
  if (state.problem?.proof && isSomewhere(state.problem.proof)) drawProof(base, state.problem.proof);
  scaleBar(base);
}

function drawTop() {
  top.setTransform(1, 0, 0, 1, 0, 0);
  top.clearRect(0, 0, top.canvas.width, top.canvas.height);
  camera.apply(top, ratio);
  const { robot, start, goal } = state.request;
  const shape = outline(robot.footprint).filter((point) => point.every(Number.isFinite));
  if (shape.length) {
    drawPose(top, "goal", goal, shape);
    drawPose(top, "start", start, shape);
  }
  const { motion } = state;
  if (motion && !(state.stale && player.time === 0)) drawMoving(top, motion);
  else if (shape.length && isPlace(start)) drawStanding(top, shape);
  inHand.draw(top);
}

/** The planned robot at the player's time. */
function drawMoving(context, motion) {
  const place = motion.locate(player.time);
  context.globalAlpha = state.stale ? 0.5 : 1;
  const wheelAt = (name) => motion.wheelAt(name, place);
  drawRobot(context, pixel(), motion.outline, motion.poseAt(place), motion.layout, wheelAt);
  context.globalAlpha = 1;
}

/** The robot as it is set up, at the start. */
function drawStanding(context, shape) {
  const { robot, start } = state.request;
  const pose = standing(start);
  const steered = start.theta - pose.theta; // other than 0 where the body keeps a heading of its own
  const wheelAt = (name) => ({ turned: 0, steered: start.steering?.[name] ?? steered });
  drawRobot(context, pixel(), shape, pose, wheelsOf(robot.drive), wheelAt);
  drawPose(context, "start", start, shape, true);
}

/** A pose as the footprint stands: a synchro drive's body may keep another heading than its wheels. */
export function standing(pose) {
  const { drive } = state.request.robot;
  const kept = drive.type === "synchro" ? (drive.body_heading ?? state.request.start.theta) : pose.theta;
  return { ...pose, theta: kept ?? 0 };
}

function drawPose(context, which, pose, shape, plain = false) {
  if (!isPlace(pose)) return;
  const wrong = state.problem?.code?.startsWith(`${which}-`);
  const colour = palette.css[wrong ? "bad" : which];
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = (wrong ? 2.4 : 1.8) * pixel();
  const standsAt = pose.theta === null ? null : placed(shape, standing(pose));
  if (standsAt) trace(context, standsAt);
  else circle(context, pose, reach(shape));
  if (!plain) {
    context.globalAlpha = wrong ? 0.25 : 0.1;
    context.fill();
    context.globalAlpha = 1;
  }
  context.setLineDash(pose.theta === null ? [5 * pixel(), 5 * pixel()] : []);
  context.stroke();
  context.setLineDash([]);
  if (wrong && standsAt) drawHits(context, standsAt);
  if (pose.theta === null) return;
  const [hx, hy] = handle(pose);
  context.beginPath();
  context.moveTo(pose.x, pose.y);
  context.lineTo(hx, hy);
  context.lineWidth = 1.4 * pixel();
  context.stroke();
}

/** Where a pose's heading is held: ahead of the footprint, and never too near to grip. */
export function handle({ x, y, theta }) {
  const shape = outline(state.request.robot.footprint).filter((point) => point.every(Number.isFinite));
  const ahead = Math.max(...shape.map((p) => p[0]), 0) + 20 * pixel();
  const away = Math.max(ahead, 44 * pixel());
  return [x + away * Math.cos(theta), y + away * Math.sin(theta)];
}

function circle(context, { x, y }, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
}

/** Whether a proof has a place: a way too narrow, or an end where the disc does not fit. A closed wall has none. */
function isSomewhere({ x, y, width }) {
  const { robot, start, goal } = state.request;
  const near = reach(outline(robot.footprint));
  return width > 0 || [start, goal].some((pose) => Math.hypot(pose.x - x, pose.y - y) <= near);
}

/** Where a proof says that the robot cannot pass: the disc inside the footprint, and what room it has. */
function drawProof(context, { x, y, radius, width }) {
  context.strokeStyle = context.fillStyle = palette.css.bad;
  context.lineWidth = 2 * pixel();
  circle(context, { x, y }, radius);
  context.globalAlpha = 0.18;
  context.fill();
  context.globalAlpha = 1;
  context.stroke();
  if (width > 0) {
    circle(context, { x, y }, width / 2);
    context.setLineDash([4 * pixel(), 4 * pixel()]);
    context.stroke();
    context.setLineDash([]);
  }
  const arm = radius + 7 * pixel();
  context.beginPath();
  for (const [dx, dy] of [
    [1, 0],
    [-1, 0],
    [0, 1],
    [0, -1],
  ]) {
    context.moveTo(x + dx * radius, y + dy * radius);
    context.lineTo(x + dx * arm, y + dy * arm);
  }
  context.stroke();
}

function scaleBar(context) {
  const step = gridStep(camera);
  const long = step * camera.scale;
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  const x = camera.width - 22,
    y = camera.height - 14;
  context.strokeStyle = context.fillStyle = palette.css.soft;
  context.lineWidth = 1.2;
  context.beginPath();
  context.moveTo(x - long, y - 4);
  context.lineTo(x - long, y);
  context.lineTo(x, y);
  context.lineTo(x, y - 4);
  context.stroke();
  context.font = "12px Inter, system-ui, sans-serif";
  context.textAlign = "right";
  context.fillText(`${short(step)} m`, x - long - 8, y + 1);
}

export function isPlace(pose) {
  return (
    Number.isFinite(pose.x) && Number.isFinite(pose.y) && (pose.theta === null || Number.isFinite(pose.theta))
  );
}
